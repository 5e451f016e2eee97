"""Demonstrations without joints, as values: poses of the hand over time."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from .._errors import DemonstrationError, RigidTransformError
from .._rotations import pose, rotation_of_quaternion
from ._demonstrations import check_poses, check_samples


@dataclass(frozen=True, eq=False)
class PoseDemonstration:
    """One recorded motion of a hand, T samples, in the robot's base frame.

    `time` [T], s, not decreasing; `position` [T, 3], m; `quaternion` [T, 4], (w, x, y, z), of unit length, of the two
    that mean a turn always the one nearer to the sample before; `poses` of objects as a `Demonstration` has them, for
    each [4, 4] or [T, 4, 4]. Arrays are kept as read-only float64 copies.

    **Raises** `DemonstrationError` for arrays that do not fit together, numbers that are not finite, and time running
    backwards; `RigidTransformError` for quaternions whose length is off 1 by more than a hundredth.
    """

    time: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    poses: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self):
        try:
            time, position, quaternion = (np.array(a, np.float64) for a in (self.time, self.position, self.quaternion))
            poses = {str(name): np.array(T, np.float64) for name, T in self.poses.items()}
        except (TypeError, ValueError) as error:
            raise DemonstrationError(f"the poses are not arrays of numbers: {error}.") from error
        if position.shape != (len(time), 3) or quaternion.shape != (len(time), 4):
            raise DemonstrationError(
                f"positions have shape {position.shape}, quaternions {quaternion.shape} and time {time.shape}, "
                "expected [T, 3], [T, 4] and [T]."
            )
        check_samples(time, np.hstack([position, quaternion]), "position and quaternion", "the hand")
        length = np.linalg.norm(quaternion, axis=1)
        if (bad := np.flatnonzero(~(np.abs(length - 1.0) < 1e-2))).size:
            raise RigidTransformError(
                f"the hand's quaternion at sample {bad[0]} has length {length[bad[0]]:.4g}, expected 1: "
                f"{quaternion[bad[0]]}."
            )
        for name, T in poses.items():
            check_poses(T, len(time), f"the pose of {name!r}")
        quaternion = alike(quaternion / length[:, None])
        for name, array in (("time", time), ("position", position), ("quaternion", quaternion)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        for T in poses.values():
            T.flags.writeable = False
        object.__setattr__(self, "poses", MappingProxyType(poses))

    @property
    def hand(self) -> np.ndarray:
        """The poses [T, 4, 4] of the hand."""
        return pose(self.position, rotation_of_quaternion(self.quaternion))


@dataclass(frozen=True, eq=False)
class PoseDemonstrationSet:
    """Two or more `demonstrations` of the same motion; `source`, where they come from; `layout`, what was read of it.

    The quaternions of all begin on the same side as those of the first. **Raises** `DemonstrationError` if there are
    fewer than two, or they have other objects.
    """

    demonstrations: tuple[PoseDemonstration, ...]
    source: str = "unknown"
    layout: str = ""

    def __post_init__(self):
        object.__setattr__(self, "demonstrations", tuple(self.demonstrations))
        if len(self.demonstrations) < 2:
            raise DemonstrationError(
                f"received {len(self.demonstrations)} demonstration(s) ({self.source}), but learning needs at least "
                "two."
            )
        first = self.demonstrations[0]
        for k, demonstration in enumerate(self.demonstrations):
            if set(demonstration.poses) != set(first.poses):
                raise DemonstrationError(
                    f"demonstration {k} has the objects {sorted(demonstration.poses)}, demonstration 0 has "
                    f"{sorted(first.poses)}: all demonstrations need the same."
                )
        turned = (d.quaternion if d.quaternion[0] @ first.quaternion[0] >= 0 else -d.quaternion for d in self)
        same = tuple(replace(d, quaternion=q) for d, q in zip(self, turned, strict=True))
        object.__setattr__(self, "demonstrations", same)

    def __len__(self):
        return len(self.demonstrations)

    def __iter__(self):
        return iter(self.demonstrations)

    def __getitem__(self, k: int) -> PoseDemonstration:
        return self.demonstrations[k]

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of the objects whose poses were recorded."""
        return tuple(self.demonstrations[0].poses)


def alike(quaternion: np.ndarray) -> np.ndarray:
    """The same turns by quaternions [T, 4] none of which is nearer to the negative of the one before."""
    flips = np.einsum("ti,ti->t", quaternion[1:], quaternion[:-1]) < 0
    return quaternion * np.where(np.cumsum(np.concatenate([[False], flips])) % 2, -1.0, 1.0)[:, None]
