"""A depth camera over the live scene: what the policy is told of the object is what the camera's images say."""

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._rotations import rotation_angle
from ..kinematics._mujoco import import_mujoco
from ..perception import (
    DepthTracker,
    Estimate,
    MeasuredPoints,
    measured_depth,
    measured_points,
    robot_spheres,
)
from ..scenes import Scene
from ..world import RobotSpheres
from ._depth_nodes import DepthNodes

_BOARD = 0.5  # m before the camera, where a board hides everything
_TELL, _POINTS = 0.25, 0.1  # seconds from one text, and from one cloud of points, to the next
_NICE = 10  # of the camera's thread: the policy comes first


class Sight(NamedTuple):
    """What the camera knows after an image: `seen` [4, 4], the object's pose where it was seen last; `lost`, whether
    this image did not show it, and `since`, for how many seconds, infinite where it never was seen; `rate`, images a
    second; how far `seen` is from where the object is: `position`, m, `angle`, rad, and `joints`, by name, in words."""

    seen: np.ndarray
    lost: bool
    since: float
    rate: float
    position: float
    angle: float
    joints: dict[str, str]

    @property
    def words(self) -> str:
        """All that in a line of Markdown."""
        off = f"off by {1000 * self.position:.1f} mm, {np.degrees(self.angle):.2f}°"
        off += "".join(f", {name} {value}" for name, value in self.joints.items())
        if not self.lost:
            return f"**seen** · {self.rate:.0f} images/s · {off} from where it is"
        if np.isinf(self.since):
            return f"**not found yet** · {self.rate:.0f} images/s · the policy has a rough guess, {off}"
        return (
            f"**lost** for {self.since:.1f} s · {self.rate:.0f} images/s · the policy goes on with the pose seen last, "
            f"{off} from where it is"
        )


class DepthView:
    """The camera's thread, its controls, and what of it is on the page.

    `sight`, after the newest image; None before the first. `ready` is set once there is one, or `failure`, what ended
    the thread otherwise.

    **Arguments**: `server`; `scene`, whose object is looked for; `opened`, within which there is a `DepthTracker`: it
    is entered in the thread, since a renderer belongs to one; `spheres` that hold the robot, or None; `where`, which
    gives the arm's joints [n] and the object's pose [4, 4] as they are now.
    """

    def __init__(
        self,
        server: Any,
        scene: Scene,
        opened: Callable[[], AbstractContextManager[DepthTracker]],
        spheres: RobotSpheres | None,
        where: Callable[[], tuple[np.ndarray, np.ndarray]],
    ):
        self._server, self._scene, self._opened, self._where = server, scene, opened, where
        self._spheres = spheres
        gui = server.gui
        self.text = gui.add_markdown("the camera is being placed ...")
        self.points = gui.add_checkbox("measured points", True)
        self.estimate = gui.add_checkbox("estimate", True)
        self.hidden = gui.add_checkbox("hold a board before the camera", False, hint="The camera sees the board alone.")
        gui.add_markdown("Points: the object's orange, the robot's blue, others grey.")
        self.sight: Sight | None = None
        self.ready, self._end = threading.Event(), threading.Event()
        self.failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def start(self) -> None:
        """Look from now on; `ready` says when there is something to be told."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread, and wait for it."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join(timeout=60.0)

    def told(self, T_world_object: np.ndarray) -> np.ndarray:
        """The pose [4, 4] that the policy gets: that seen last, or before any image the one given."""
        return T_world_object if self.sight is None else self.sight.seen

    @property
    def by(self) -> str:
        """By what the policy knows of its goal, to be added to words about it."""
        if self.sight is None or not self.sight.lost:
            return ", by what the camera sees"
        return ", by a guess" if np.isinf(self.sight.since) else ", **by what the camera saw last**"

    def _run(self) -> None:
        if sys.platform == "linux":
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
        try:
            with self._opened() as tracker:
                self._follow(tracker)
        except BaseException as error:
            self.failure = error
        finally:
            self.ready.set()

    def _follow(self, tracker: DepthTracker) -> None:
        nodes = DepthNodes(self._server, self._scene, tracker.model, tracker.camera, _BOARD)
        data, seed = self._scene.fresh(), (0,)
        self._put(data)
        estimate = tracker.start(self._scene, data, seed).estimate
        sorted_out = jax.jit(self._sorter(tracker))
        stamp, images = -np.inf if estimate.lost else time.monotonic(), deque[float]()
        drawn = told = 0.0
        number, at = 0, time.monotonic()
        while not self._end.is_set():
            board = bool(self.hidden.value)
            q, T = self._put(data)
            depth = tracker.render(data, tracker.camera)
            depth = np.full_like(depth, _BOARD) if board else depth
            measured = measured_depth(tracker.noise, depth, np.random.default_rng((*seed, 2, number)))
            q = np.asarray(q, measured.dtype)
            estimate = jax.tree.map(np.asarray, tracker.step(estimate, measured, tracker.camera, q))
            now, number = time.monotonic(), number + 1
            stamp = stamp if estimate.lost else now
            images.append(now)
            while now - images[0] > 1.0:
                images.popleft()
            self.sight = self._compared(tracker, estimate, T, data, now - stamp, len(images))
            with self._server.atomic():
                nodes.estimate(estimate, bool(self.estimate.value))
                nodes.board(board)
                if now - drawn > _POINTS:
                    drawn = now
                    nodes.points(sorted_out(estimate, measured, q), bool(self.points.value))
                if now - told > _TELL:
                    told, self.text.content = now, self.sight.words
            self.ready.set()
            at = max(at + 1 / tracker.settings.rate, time.monotonic())
            self._end.wait(at - time.monotonic())

    def _put(self, data: Any) -> tuple[np.ndarray, np.ndarray]:
        """The scene in `data` as it is on the page now; the arm's joints and the object's pose."""
        q, T = self._where()
        self._scene.move_object(data, T)
        data.qpos[self._scene.arm_qpos] = q
        mujoco = import_mujoco()
        mujoco.mj_kinematics(self._scene.model, data)
        mujoco.mj_camlight(self._scene.model, data)
        return q, T

    def _sorter(self, tracker: DepthTracker) -> Callable[[Estimate, Any, Any], MeasuredPoints]:
        def sort(estimate: Estimate, depth: Any, q: Any) -> MeasuredPoints:
            none = jnp.zeros((0, 3)), jnp.zeros(0)
            held = none if self._spheres is None else robot_spheres(self._scene.robot, self._spheres, q)
            return measured_points(tracker.model, tracker.settings, estimate, depth, tracker.camera, *held)

        return sort

    def _compared(
        self, tracker: DepthTracker, estimate: Estimate, T: np.ndarray, data: Any, since: float, rate: float
    ) -> Sight:
        seen = np.asarray(estimate.T_world_object, float)
        angle = float(rotation_angle(T[:3, :3].T @ seen[:3, :3]))
        position = float(np.linalg.norm(seen[:3, 3] - T[:3, 3]))
        joints = {}
        for joint, q in zip(tracker.model.robot.model.joints, estimate.q, strict=True):
            off = abs(float(q - data.joint(joint.name).qpos[0]))
            turns = joint.kind == "revolute"
            joints[joint.name] = f"{np.degrees(off):.2f}°" if turns else f"{1000 * off:.1f} mm"
        return Sight(seen, bool(estimate.lost), since, rate, position, angle, joints)
