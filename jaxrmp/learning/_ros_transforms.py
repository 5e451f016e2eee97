"""Poses of frames from recorded transforms between frames, as ROS publishes them."""

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np

from .._errors import DemonstrationError, UnknownNameError, importing
from .._rotations import pose
from ..kinematics import Robot, frame_poses

_WORLD = "world"  # the root of every model, and a frame of many bags


class Transforms:
    """Transforms of each frame in its parent over time, of the messages of a bag, `where`."""

    def __init__(self, messages: Iterable[tuple[bool, Any]], where: str):
        self.where = where
        self._parent: dict[str, str] = {}
        self._second_parent: dict[str, str] = {}
        rows: dict[str, list[tuple[float, ...]]] = {}
        stamps: dict[str, list[int]] = {}
        moved: set[str] = set()
        for static, message in messages:
            parent, child = message.header.frame_id.lstrip("/"), message.child_frame_id.lstrip("/")
            if self._parent.setdefault(child, parent) != parent:
                self._second_parent[child] = parent
            if not static:
                moved.add(child)
            p, r = message.transform.translation, message.transform.rotation
            stamps.setdefault(child, []).append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
            rows.setdefault(child, []).append((p.x, p.y, p.z, r.x, r.y, r.z, r.w))
        self._static = set(self._parent) - moved
        self._stamps = {child: np.array(at, np.int64) for child, at in stamps.items()}
        self._rows = {child: np.array(row) for child, row in rows.items()}

    @property
    def frames(self) -> list[str]:
        return list(dict.fromkeys([*self._parent.values(), *self._parent]))

    def pose(self, base: str, frame: str, stamps: np.ndarray) -> tuple[np.ndarray, float]:
        """The pose of `frame` in `base` at `stamps` [T], ns: [T, 4, 4], or [4, 4] if all on the way is static; and how
        far the recorded transforms are from the stamps at most, s. **Raises** `DemonstrationError`."""
        for name in (base, frame):
            UnknownNameError.check(f"frame of the transforms in {self.where}", name, self.frames)
        up, down = self._chain(base), self._chain(frame)
        if up[-1] != down[-1]:
            raise DemonstrationError(f"{self.where}: no transforms lead from {base!r} to {frame!r}.")
        shared = set(up) & set(down)
        moving = [child for chain in (up, down) for child in chain if child not in shared]
        (T_root_base, age_base), (T_root_frame, age) = (
            self._down([c for c in chain if c in moving], stamps) for chain in (up, down)
        )
        T = np.linalg.inv(T_root_base) @ T_root_frame
        return T, max(age_base, age)

    def _chain(self, frame: str) -> list[str]:
        """`frame` and what it hangs on, the root last."""
        chain = [frame]
        while (child := chain[-1]) in self._parent:
            if child in self._second_parent:
                raise DemonstrationError(
                    f"{self.where}: frame {child!r} has two parents, {self._parent[child]!r} and "
                    f"{self._second_parent[child]!r}: cut the bag where that changes."
                )
            chain.append(self._parent[chain[-1]])
            if chain[-1] in chain[:-1]:
                raise DemonstrationError(f"{self.where}: the transforms of {chain[-1]!r} form a loop.")
        return chain

    def _down(self, chain: list[str], stamps: np.ndarray) -> tuple[np.ndarray, float]:
        T, age = np.eye(4), 0.0
        for child in reversed(chain):
            own, late = self._at(child, stamps)
            T, age = T @ own, max(age, late)
        return T, age

    def _at(self, child: str, stamps: np.ndarray) -> tuple[np.ndarray, float]:
        with importing("scipy", "formats"):
            from scipy.spatial.transform import Rotation, Slerp
        rows = self._rows[child]
        if not (length := np.linalg.norm(rows[:, 3:], axis=1)).all():
            raise DemonstrationError(
                f"{self.where}: transform {int(length.argmin())} of {child!r} has a quaternion of zeros."
            )
        if child in self._static:
            return pose(rows[-1, :3], Rotation.from_quat(rows[-1, 3:]).as_matrix()), 0.0
        at, first = np.unique(self._stamps[child], return_index=True)
        seconds, wanted = (at - stamps[0]) * 1e-9, (stamps - stamps[0]) * 1e-9
        rows, inside = rows[first], np.clip(wanted, seconds[0], seconds[-1])
        p = np.stack([np.interp(inside, seconds, column) for column in rows[:, :3].T], axis=-1)
        R = Rotation.from_quat(rows[:, 3:])
        R = (
            Slerp(seconds, R)(inside).as_matrix()
            if len(rows) > 1
            else np.broadcast_to(R.as_matrix(), (len(stamps), 3, 3))
        )
        after = np.clip(np.searchsorted(seconds, wanted), 1, max(len(seconds) - 1, 1))
        nearest = np.minimum(
            np.abs(wanted - seconds[after - 1]), np.abs(wanted - seconds[min(1, len(seconds) - 1) * after])
        )
        return pose(p, R), float(nearest.max())


def base_frame(base: str, robot: Robot | None, frames: list[str]) -> tuple[str, np.ndarray]:
    """The frame to take for `base`, and its pose in it.

    A recorded link of the `robot` that stands still, whose pose in `base` the model says; without one, the frame of
    that name: the world of a bag need not be the model's.
    """
    if robot is None or base not in robot.frame_names:
        return base, np.eye(4)
    with jax.enable_x64(True):
        rest, bent = (
            dict(zip(robot.frame_names, np.asarray(frame_poses(robot, q, robot.frame_names)), strict=True))
            for q in (np.full(robot.num_joints, angle) for angle in (0.0, 0.3))
        )
    still = [name for name in rest if np.array_equal(rest[name], bent[name])]
    if base in still:
        for name in (base, *still):
            if name in frames and name != _WORLD:
                return name, np.linalg.inv(rest[base]) @ rest[name]
    return base, np.eye(4)
