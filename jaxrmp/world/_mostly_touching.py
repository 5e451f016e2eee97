"""Pairs of a robot's spheres that touch so often that it is no collision, but how coarsely links are covered."""

import numpy as np

from ..kinematics import Robot
from ..kinematics._arranged import pose_of
from ..kinematics._body_poses import body_poses
from ._robot_spheres import RobotSpheres

_CONFIGURATIONS = 200
_MOST = 0.25  # of configurations in which two links may touch


def without_mostly_touching(robot: Robot, spheres: RobotSpheres, pairs) -> tuple[tuple[int, int], ...]:
    """The `pairs` without those that touch most often, until no two links touch in more than a quarter of many
    configurations within the joints' limits: more often than that it is their cover, not they."""
    if not pairs:
        return ()
    first, second = np.array(pairs).T
    sums = np.asarray(spheres.radii)[first] + np.asarray(spheres.radii)[second]
    at = centers(robot, spheres, _configurations(robot))
    touching = np.stack([np.linalg.norm(c[first] - c[second], axis=1) < sums for c in at])
    links: dict[tuple[str, str], list[int]] = {}
    for k, (i, j) in enumerate(pairs):
        links.setdefault((spheres.frames[i], spheres.frames[j]), []).append(k)
    kept = np.ones(len(pairs), bool)
    for rows in links.values():
        often = sorted(rows, key=lambda k: touching[:, k].sum())
        while often and touching[:, often].any(axis=1).mean() > _MOST:
            kept[often.pop()] = False
    return tuple(pair for pair, keep in zip(pairs, kept, strict=True) if keep)


def _configurations(robot: Robot) -> np.ndarray:
    """The middle of the joints' ranges, and random ones in them."""
    lower, upper = _ranges(robot)
    return np.concatenate([(lower + upper)[None] / 2, random_configurations(robot, _CONFIGURATIONS)])


def random_configurations(robot: Robot, count: int, seed: int = 0) -> np.ndarray:
    """Configurations [count, n] drawn evenly within the joints' limits; joints without limits turn once."""
    lower, upper = _ranges(robot)
    random = np.random.default_rng(seed).uniform(size=(count, robot.num_joints))
    return lower + random * (upper - lower)


def _ranges(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    lower, upper = (np.asarray(limit, float) for limit in (robot.lower, robot.upper))
    return np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)


def centers(robot: Robot, spheres: RobotSpheres, q: np.ndarray) -> np.ndarray:
    """The centres [N, K, 3] in the world in configurations `q` [N, n]."""
    poses, centers = body_poses(robot.model, q), []
    for name, offset in zip(spheres.frames, np.asarray(spheres.offsets), strict=True):
        frame = robot.model.frames[robot.frame_index(name)]
        centers.append((poses[frame.body] @ (pose_of(frame) @ [*offset, 1.0]))[:, :3])
    return np.stack(centers, axis=1)
