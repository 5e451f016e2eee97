"""How far a robot is from itself along postures: which two of its spheres come closest, and where."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..kinematics import Robot
from ..kinematics._body_poses import body_poses
from ._mostly_touching import centers
from ._robot_spheres import RobotSpheres

_AT_ONCE = 512  # postures


class SelfClearance(NamedTuple):
    """The least `distance` of pairs of spheres, m, below 0 where they overlap, infinite without pairs; the `frames` of
    the closest two, and the `posture` in which they are, an index, of those that were looked at."""

    distance: float
    frames: tuple[str, str]
    posture: int


def self_clearance(robot: Robot, spheres: RobotSpheres, pairs: Sequence[Any], q: Any) -> SelfClearance:
    """The closest that `pairs` (i, j) of `spheres` on a `robot` come in postures `q` [N, n], rad or m, in NumPy.

    **Raises** `UnknownNameError` for spheres on frames that are not there.
    """
    apart, closest = _apart(robot, spheres, pairs, q)
    if not apart.size or not len(pairs):
        return SelfClearance(np.inf, ("", ""), 0)
    at = int(np.argmin(apart))
    i, j = pairs[int(closest[at])]
    return SelfClearance(float(apart[at]), (spheres.frames[i], spheres.frames[j]), at)


def self_distance(robot: Robot, spheres: RobotSpheres, pairs: Sequence[Any], q: Any) -> np.ndarray:
    """How far the closest of `pairs` is apart in each of postures `q` [N, n], [N], m; the rest as `self_clearance`."""
    return _apart(robot, spheres, pairs, q)[0]


def height_above(robot: Robot, spheres: RobotSpheres, body: int, q: np.ndarray) -> np.ndarray:
    """How far the centre of the lowest of `spheres` is above `body`, along its z axis as it stands in the first of
    postures `q` [N, n], [N], m; infinite without spheres."""
    if not spheres.size:
        return np.full(len(q), np.inf)
    T = body_poses(robot.model, q[:1])[body][0]
    return ((centers(robot, spheres, q) - T[:3, 3]) @ T[:3, 2]).min(axis=1)


def _apart(robot: Robot, spheres: RobotSpheres, pairs: Sequence[Any], q: Any) -> tuple[np.ndarray, np.ndarray]:
    """The distance of the closest pair in each posture, m, and its index."""
    q = np.asarray(q, float)
    if not len(pairs):
        return np.full(len(q), np.inf), np.zeros(len(q), int)
    i, j = np.array(pairs).T
    radii = np.asarray(spheres.radii)[i] + np.asarray(spheres.radii)[j]
    apart, closest = np.empty(len(q)), np.empty(len(q), int)
    for first in range(0, len(q), _AT_ONCE):
        at = slice(first, first + _AT_ONCE)
        for row, p in enumerate(centers(robot, spheres, q[at]).astype(np.float32), first):
            distances = np.linalg.norm(p[i] - p[j], axis=1) - radii
            closest[row] = np.argmin(distances)
            apart[row] = distances[closest[row]]
    return apart, closest
