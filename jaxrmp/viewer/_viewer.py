"""The page of `jaxrmp view`: a policy running live, a skill with its demonstrations or a hand-designed one."""

import threading
from typing import Any

import numpy as np

from ..learning import PreparedDemonstrations, Skill, reproduce
from ._lines import DEMONSTRATED, REPRODUCED, TARGET, PathLines, add_outline
from ._loop import Frame
from ._poses import place
from ._recorder import Recording
from ._server import Access
from ._session import Content, Session


class Viewer(Session):
    """A live policy on a page, to be dragged, pushed, tuned and watched.

    **Arguments**: `content`, by `skill_content` or `reach_content`; `port`; with a skill, `skill` itself and its
    `prepared` demonstrations, where they could be had; `replayed`, a `Recording` to be played before the policy takes
    over, and again by a button; `access`, who may see it, by default this machine alone. **Raises** as `Session`.
    """

    def __init__(
        self,
        content: Content,
        port: int = 8080,
        *,
        skill: Skill | None = None,
        prepared: PreparedDemonstrations | None = None,
        replayed: Recording | None = None,
        access: Access | None = None,
    ):
        self.skill, self.prepared, self.replayed = skill, prepared, replayed
        self._lines: dict[str, PathLines] = {}
        label = "jaxrmp" if skill is None else f"jaxrmp: {skill.configuration.name}"
        super().__init__(content, port, label, access=access)

    def _build(self, server: Any, folder: str) -> None:
        super()._build(server, folder)
        if self.replayed is not None:
            self.replay = server.gui.add_button("Replay", icon="player-track-next", hint="What was recorded, again.")
            self.replay.on_click(lambda _: self.play_recording())
        self._frame = server.scene.add_frame("/lines", show_axes=False)
        if self.skill is None:
            return
        targets = np.asarray(self.skill.targets, float)
        add_outline(server, "/lines/target_triangle", targets, TARGET)
        if len(set(self.skill.frames)) == 1:  # the control points on the arm, as a triangle below their frame
            name = f"/arm/{self.skill.frames[0]}/control_points"
            add_outline(server, name, np.asarray(self.skill.offsets, float), REPRODUCED)
        if self.prepared is None:
            server.gui.add_markdown("The demonstrations that the skill was learned from are not where they were.")
            return
        self._lines["demonstrations"] = PathLines(
            server, "/lines/demonstrations", self.prepared.points, DEMONSTRATED, 2.5
        )

    def _show_controls(self, server: Any) -> dict[str, Any]:
        shown = super()._show_controls(server)
        if self.prepared is None or self.skill is None:
            return shown
        starts = tuple(f"demonstration {k}" for k in range(len(self.prepared.joints.q)))
        self._start = server.gui.add_dropdown("start as", starts)
        shown["demonstrations"] = server.gui.add_checkbox("demonstrations", True)
        shown["reproductions"] = server.gui.add_checkbox("reproductions", False)
        shown["triangles"] = server.gui.add_checkbox("triangles of control points", False)
        self._reproducing = threading.Lock()

        @self._start.on_update
        async def _(_: Any) -> None:
            self.restart()

        @shown["reproductions"].on_update
        def _(_: Any) -> None:
            if shown["reproductions"].value:
                self.reproduce()

        return shown

    def restart(self) -> None:
        """The arm at rest where the chosen demonstration started, the object where it was then."""
        if self.prepared is None or self.skill is None:
            super().restart()
            return
        k = int(self._start.value.split()[-1])
        self.loop.reset(self.prepared.joints.q[k][0])

    def start(self) -> None:
        if self.replayed is not None:
            self.loop.replay(self.replayed.at)
        super().start()

    def play_recording(self) -> None:
        """Play what was recorded from its beginning; the policy takes over where it ends."""
        assert self.replayed is not None
        self.set_playing(True)
        self.loop.replay(self.replayed.at)

    def reproduce(self) -> None:
        """Roll the skill out from every demonstration's start and draw it, once."""
        assert self.skill is not None and self.prepared is not None
        with self._reproducing:
            if "reproductions" in self._lines:
                return
            self.notify("Rolling the skill out from each demonstration's start ...")
            found = reproduce(self.skill, self.content.policy.robot, self.prepared)
            self._lines["reproductions"] = PathLines(self.server, "/lines/reproductions", found.points, REPRODUCED, 1.5)
            dtw, turn = found.mean["dtw_cm"], found.mean["turn_deg"]
            how_far = f"DTW {dtw:.2f} cm" if dtw is not None else f"turn {turn:.1f} degrees off"
            self.notify(f"Reproduced: mean {how_far}.")

    def draw(self, frame: Frame) -> None:
        super().draw(frame)
        place(self._frame, np.asarray(frame.situation.T_world_target, float))
        for name, lines in tuple(self._lines.items()):  # another thread adds to them
            lines.show(bool(self.shown[name].value), bool(self.shown["triangles"].value))
