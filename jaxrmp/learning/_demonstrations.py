"""Demonstrations as values: joint trajectories with the poses of the objects that were there."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from .._errors import DemonstrationError, RigidTransformError, UnknownNameError
from .._task_map import check_rigid

JOINT_UNITS = ("rad", "degrees", "normalised")


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One recorded motion of T samples.

    `time` [T], s, not decreasing (repeated stamps are allowed); `q` [T, n], joint positions, rad or m; `poses`, for
    each object its pose in the robot's base frame: [4, 4] if it stood still, [T, 4, 4] if it was tracked.
    Arrays are kept as read-only float64 copies.

    **Raises** `DemonstrationError` if something is not an array of numbers; a `DemonstrationSet` checks the rest.
    """

    time: np.ndarray
    q: np.ndarray
    poses: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self):
        object.__setattr__(self, "time", _numbers(self.time, "time"))
        object.__setattr__(self, "q", _numbers(self.q, "q"))
        poses = {str(name): _numbers(T, f"the pose of {name!r}") for name, T in self.poses.items()}
        object.__setattr__(self, "poses", MappingProxyType(poses))

    def pose(self, name: str, sample: int = 0) -> np.ndarray:
        """The pose [4, 4] of object `name` in the base frame at index `sample`. **Raises** `UnknownNameError`."""
        UnknownNameError.check("object", name, self.poses)
        T = self.poses[name]
        return T if T.ndim == 2 else T[sample]


@dataclass(frozen=True, eq=False)
class DemonstrationSet:
    """Two or more `demonstrations` of the same skill on the same robot.

    `joint_names`, in the order of `q`'s columns; `robot`, its name; `source`, where the demonstrations come from;
    `units` of `q`: rad (sliding joints m), or as recorded, degrees or normalised (-100 to 100 over a joint's range),
    which `fit_to_robot` turns into rad; `layout`, what was read of the source and what not.

    **Raises** `DemonstrationError` if there are fewer than two, or one of them has other joints or objects than the
    rest, holds non-finite numbers, or has time running backwards; `RigidTransformError` if an object's pose is not a
    rigid transform. The messages say which demonstration, and at which sample.
    """

    demonstrations: tuple[Demonstration, ...]
    joint_names: tuple[str, ...]
    robot: str = "unknown"
    source: str = "unknown"
    units: str = "rad"
    layout: str = ""

    def __post_init__(self):
        UnknownNameError.check("unit of joints", self.units, JOINT_UNITS)
        object.__setattr__(self, "demonstrations", tuple(self.demonstrations))
        object.__setattr__(self, "joint_names", tuple(str(name) for name in self.joint_names))
        twice = [name for name in self.joint_names if self.joint_names.count(name) > 1]
        if twice:
            raise DemonstrationError(f"joint_names has {twice[0]!r} twice ({self.source}): one column a joint.")
        if len(self.demonstrations) < 2:
            raise DemonstrationError(
                f"received {len(self.demonstrations)} demonstration(s) ({self.source}), but learning needs at least "
                "two: record more of the same skill."
            )
        for k, demonstration in enumerate(self.demonstrations):
            check_demonstration(demonstration, self.joint_names, f"demonstration {k}")
            if set(demonstration.poses) != set(self.object_names):
                raise DemonstrationError(
                    f"demonstration {k} has the objects {sorted(demonstration.poses)}, demonstration 0 has "
                    f"{sorted(self.object_names)}: all demonstrations need the same."
                )

    def __len__(self):
        return len(self.demonstrations)

    def __iter__(self):
        return iter(self.demonstrations)

    def __getitem__(self, k: int) -> Demonstration:
        return self.demonstrations[k]

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of the objects whose poses were recorded."""
        return tuple(self.demonstrations[0].poses)


def check_demonstration(demonstration: Demonstration, joint_names: tuple[str, ...], where: str) -> None:
    """Raise what `DemonstrationSet` raises about one demonstration, calling it `where` in the message."""
    time, q = demonstration.time, demonstration.q
    if q.ndim != 2 or q.shape[1] != len(joint_names):
        raise DemonstrationError(
            f"{where}: joint positions have shape {q.shape}, expected [T, {len(joint_names)}] for the joints "
            f"{list(joint_names)}."
        )
    check_samples(time, q, "joint positions", where)
    for name, T in demonstration.poses.items():
        check_poses(T, len(time), f"{where}: the pose of {name!r}")


def check_samples(time: np.ndarray, values: np.ndarray, what: str, where: str) -> None:
    """Raise `DemonstrationError` unless `values` [T, n] and their `time` [T] are numbers in the order of time."""
    if time.shape != (len(values),):
        raise DemonstrationError(f"{where}: time has shape {time.shape} but there are {len(values)} rows of {what}.")
    if len(time) < 2:
        raise DemonstrationError(f"{where}: has {len(time)} sample(s); a motion needs at least two.")
    for name, table in (("time", time[:, None]), (what, values)):
        bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
        if bad.size:
            raise DemonstrationError(
                f"{where}: {name} not finite at sample {bad[0]} ({table[bad[0]].tolist()}), and {bad.size} such "
                "sample(s) in all. Remove them, or record again."
            )
    back = np.flatnonzero(np.diff(time) < 0)
    if back.size:
        i = int(back[0])
        raise DemonstrationError(
            f"{where}: time runs backwards at sample {i + 1}, from {time[i]:.6g} s to {time[i + 1]:.6g} s."
        )


def check_poses(T: np.ndarray, samples: int, what: str) -> None:
    """Raise `DemonstrationError` or `RigidTransformError` unless `T` is one pose [4, 4] or one per sample."""
    if T.shape not in ((4, 4), (samples, 4, 4)):
        raise DemonstrationError(f"{what} has shape {T.shape}, expected (4, 4) or ({samples}, 4, 4).")
    try:
        check_rigid(T, what)
    except RigidTransformError:
        if T.ndim == 3:
            for i, pose in enumerate(T):
                check_rigid(pose, f"{what} at sample {i}")
        raise


def _numbers(value, name: str) -> np.ndarray:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DemonstrationError(f"{name} is not an array of numbers: {error}.") from error
    array.flags.writeable = False
    return array
