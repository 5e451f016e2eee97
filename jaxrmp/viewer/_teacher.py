"""The page of `jaxrmp teach`: the hand is dragged, and what it does is recorded."""

import threading
from pathlib import Path
from typing import Any

import numpy as np

from .._counted import counted
from .._errors import DemonstrationError, JaxrmpError
from ..learning import check_replaceable
from ._inputs import with_gain
from ._lines import DEMONSTRATED, PathLines
from ._loop import Frame
from ._poses import place, pose_of
from ._recorder import Recorder
from ._server import Access
from ._session import Content, Session
from ._taught_configuration import write_configuration

BY_HAND, BY_JOINTS = "drag the hand", "joint sliders"
_JOINT_GAINS = {  # in place of the hand's leaves, a stiff posture that the sliders set
    "hand_position.weight_near": 0.0,
    "hand_position.weight_far": 0.0,
    "hand_orientation.weight": 0.0,
    "posture.weight": 1.0,
    "posture.stiffness": 100.0,
    "posture.damping_rate": 20.0,
}


class Teacher(Session):
    """A robot on a page that is moved by its hand, or joint by joint, and what is recorded of that.

    The hand follows its gizmo by damped inverse kinematics made of this library's leaves: an attractor, an orientation
    attractor, joint limits, posture and damping.

    **Arguments**: `content`, by `reach_content`; `out`, the folder that demonstrations are saved to; `robot`, as named
    by the user; `overwrite`, whether demonstrations that are there may be replaced; `port`; `access`, who may
    see it, by default this machine alone.
    **Raises** `DemonstrationError` if `out` is not empty and may not be replaced, else as `Session`.
    """

    def __init__(
        self,
        content: Content,
        out: Path,
        robot: str = "panda",
        *,
        overwrite: bool = False,
        port: int = 8080,
        access: Access | None = None,
    ):
        check_replaceable(out, overwrite)
        self.out, self._robot_name, self._overwrite = out, robot, overwrite
        self.recorder = Recorder()
        self._drawn: PathLines | None = None
        self._busy = threading.Lock()
        self._by_sliders = False
        super().__init__(content, port, "jaxrmp: teach", folder="Teach", access=access)

    def _build(self, server: Any, folder: str) -> None:
        super()._build(server, folder)
        gui = server.gui
        self.target_frame = server.scene.add_transform_controls("/target_frame", scale=0.16, visible=False)
        place(self.target_frame, self.content.T_world_target)
        server.scene.add_frame("/target_frame/axes", axes_length=0.08, axes_radius=0.004)
        assert self.folder is not None
        with self.folder:
            self.mode = gui.add_dropdown("move it by", (BY_HAND, BY_JOINTS))
            self._sliders = self._joint_sliders(gui)
            self.record = gui.add_button("Record", icon="player-record", color="red")
            self.list = gui.add_dropdown("demonstration", ("none yet",))
            self.replay = gui.add_button("Replay", icon="player-play")
            self.discard = gui.add_button("Discard", icon="trash")
            self.targeted = gui.add_checkbox("target frame", False, hint="The skill will live in this frame.")
            self.mark = gui.add_button("Mark target at the hand", icon="focus-2")
            self.save = gui.add_button("Save", icon="device-floppy", color="green")
            self.told = gui.add_markdown("Press Record, drag the hand, press Stop. Six times make a skill.")
        self.mode.on_update(self._guarded_action(self._change_mode))
        self.record.on_click(self._guarded_action(self._toggle_recording))
        for name in ("replay", "discard", "mark", "save"):
            getattr(self, name).on_click(self._guarded_action(getattr(self, f"_{name}")))

    def _joint_sliders(self, gui: Any) -> list[Any]:
        robot, sliders = self.content.policy.robot, []
        rows = zip(robot.joint_names, np.asarray(robot.lower), np.asarray(robot.upper), self.content.q, strict=True)
        for name, low, high, q in rows:
            low, high = (float(v if np.isfinite(v) else w) for v, w in ((low, -np.pi), (high, np.pi)))
            value = float(np.clip(q, low, high))
            sliders.append(gui.add_slider(name, low, high, step=0.001, initial_value=value, visible=False))
        return sliders

    def _guarded_action(self, act: Any) -> Any:
        """What a button does: one at a time, and a mistake is told on the page."""

        def run(_: Any) -> None:
            with self._busy:
                try:
                    act()
                except (JaxrmpError, OSError) as error:
                    self.tell(str(error))
                    self.notify(str(error))

        return run

    def tell(self, message: str) -> None:
        """Show `message` below the buttons."""
        self.told.content = message

    def policy(self) -> Any:
        policy = super().policy()
        if not self._by_sliders:
            return policy
        q = tuple(float(slider.value) for slider in self._sliders)
        known = getattr(self, "_by_joints", None)
        if known is None or known[:2] != (id(policy), q):
            stiff = policy
            for path, value in {**_JOINT_GAINS, "posture.rest": np.array(q)}.items():
                stiff = with_gain(stiff, path, value)
            known = self._by_joints = (id(policy), q, stiff)
        return known[2]

    def on_frame(self, frame: Frame) -> None:
        self.recorder.add(frame.time, frame.q, self.pose(frame, self.content.hand)[:3, 3])

    def draw(self, frame: Frame) -> None:
        super().draw(frame)
        self.target_frame.visible = bool(self.targeted.value)
        if self.loop.replaying:
            self._bring_controls_to_the_arm(frame)

    def restart(self) -> None:
        """The arm, its gizmo and its sliders as they were at the start."""
        self.loop.replay(None)
        place(self.target, self.content.T_world_target)
        for slider, q in zip(self._sliders, self.content.q, strict=True):
            slider.value = float(q)
        super().restart()

    def _bring_controls_to_the_arm(self, frame: Frame) -> None:
        """Gizmo and sliders to where the arm is, so that it stays there."""
        place(self.target, self.pose(frame, self.content.hand))
        if self.mode.value == BY_JOINTS:
            for slider, q in zip(self._sliders, frame.q, strict=True):
                slider.value = float(q)

    def _change_mode(self) -> None:
        self._bring_controls_to_the_arm(self.loop.frame)
        self._by_sliders = self.mode.value == BY_JOINTS  # not before they stand where the arm does
        for slider in self._sliders:
            slider.visible = self._by_sliders

    def _toggle_recording(self) -> None:
        if not self.recorder.recording:
            self.loop.replay(None)
            self.recorder.begin(pose_of(self.target_frame) if self.targeted.value else None)
            self.record.label, self.record.icon = "Stop", "player-stop"
            self.tell("Recording ...")
            return
        self.record.label, self.record.icon = "Record", "player-record"
        recording = self.recorder.end()
        self._show_list(len(self.recorder.recordings) - 1)
        self.tell(f"Demonstration {len(self.recorder.recordings)}: {recording.duration:.1f} s.")

    def _chosen(self) -> int:
        if not self.recorder.recordings:
            raise DemonstrationError("nothing is recorded yet: press Record, drag the hand, press Stop.")
        return int(self.list.value.split(":")[0]) - 1

    def _replay(self) -> None:
        self.loop.replay(self.recorder.recordings[self._chosen()].at)
        self.set_playing(True)

    def _discard(self) -> None:
        index = self._chosen()
        self.recorder.discard(index)
        self._show_list(min(index, len(self.recorder.recordings) - 1))
        self.tell(f"Discarded demonstration {index + 1}; {len(self.recorder.recordings)} are left.")

    def _mark(self) -> None:
        self.targeted.value = True
        place(self.target_frame, self.pose(self.loop.frame, self.content.hand))
        self.tell("The target frame is at the hand; its gizmo moves it.")

    def _save(self) -> None:
        if self.recorder.recording:
            raise DemonstrationError("it still records: press Stop first.")
        self.recorder.save(self.content.policy.robot, self.out, overwrite=self._overwrite)
        self._overwrite = True  # what is there now is ours
        targeted = self.recorder.recordings[0].T_world_target is not None
        joints = self.content.policy.robot.model.joints if self._robot_name != "panda" else ()
        fixed = {joint.name: joint.offset for joint in joints if joint.coordinate < 0}
        configuration = write_configuration(self.out, self._robot_name, self.content.hand, targeted, fixed)
        self.tell(
            f"Saved {counted(len(self.recorder.recordings), 'demonstration')}. Learn them with\n\n"
            f"`jaxrmp learn {configuration} --demos {self.out}`"
        )

    def _show_list(self, chosen: int) -> None:
        recordings = self.recorder.recordings
        names = tuple(f"{k + 1}: {r.duration:.1f} s" for k, r in enumerate(recordings)) or ("none yet",)
        self.list.options = names
        self.list.value = names[max(chosen, 0)]
        if self._drawn is not None:
            self._drawn.remove()
        paths = [recording.hand[:, None] for recording in recordings]
        self._drawn = PathLines(self.server, "/demonstrations", paths, DEMONSTRATED, 2.5) if paths else None
