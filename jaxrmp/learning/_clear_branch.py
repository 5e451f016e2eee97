"""Which of the postures that have a hand at the same pose a robot begins from: one in which it is clear of itself."""

import warnings

import numpy as np

from .._errors import FileWarning, JaxrmpError
from ..kinematics import Robot
from ..world._self_clearance import height_above, self_distance
from ._follow_poses import Followed, follow_poses
from ._own_clearance import OwnCover, clearance_of, own_cover

_STARTS = 96  # random postures that the first pose is sought from
_SAME = 0.1  # rad or m: two postures that differ by less, but for whole turns, are one
_STEP = 0.3  # rad or m from one sample to the next, more than which is a jump


def follow_clear(robot: Robot, frame: str, poses: np.ndarray, start: np.ndarray, source: str) -> Followed:
    """As `follow_poses`, but where the spheres on the robot would overlap on the way from `start`, from the posture
    nearest to it that has the hand at the first pose as well, and on the way from which none do.

    The arm then stays above its base, along the base's z axis, unless it was below on the way from `start`. That is
    taken if there is no other, or no geometry of the robot. A `FileWarning`, of demonstrations from
    `source`, tells if another posture was taken, and if spheres overlap at `start` itself.
    """
    found = follow_poses(robot, frame, poses, start)
    try:
        with warnings.catch_warnings():  # told where the demonstrations are learned from
            warnings.simplefilter("ignore", FileWarning)
            cover = own_cover(robot)
    except JaxrmpError:  # told there, too
        return found
    at_start = clearance_of(robot, cover, [start[None]])
    if at_start.distance < 0:
        warnings.warn(
            f"poses ({source}): at the start posture itself (poses.start) spheres on {' and '.join(at_start.frames)} "
            f"overlap by {-100 * at_start.distance:.1f} cm.",
            FileWarning,
            stacklevel=3,
        )
    overlaps = clearance_of(robot, cover, found.q)
    if overlaps.distance > 0 or not found.arrives.all():
        return found
    model, moving = robot.model, cover.spheres.moving(robot)
    first = model.joints_above(model.frames[robot.frame_index(frame)].body)[0]
    base = model.bodies[model.joints[first].body].parent

    def lowest(q: np.ndarray) -> float:
        return float(height_above(robot, moving, base, q.reshape(-1, len(start))).min())

    floor = min(lowest(found.q), 0.0)
    for begin in _others(robot, frame, poses[0, 0], start, cover):
        other = follow_poses(robot, frame, poses, begin)
        if not other.arrives.all() or np.abs(np.diff(other.q, axis=1)).max(initial=0.0) > _STEP:
            continue
        clear = clearance_of(robot, cover, other.q)
        if clear.distance > 0 and lowest(other.q) >= floor:
            warnings.warn(
                f"poses ({source}): from the start posture {overlaps}. Instead, the arm is bent otherwise to follow "
                f"the hand, clear of itself by {100 * clear.distance:.1f} cm, from {begin.round(2).tolist()} on: a "
                "start posture (poses.start) near that leads there, too.",
                FileWarning,
                stacklevel=3,
            )
            return other
    return found


def _others(robot: Robot, frame: str, pose: np.ndarray, start: np.ndarray, cover: OwnCover) -> list[np.ndarray]:
    """Postures [n], clear of the robot itself, that have `frame` at `pose` [4, 4], the nearest to `start` first; of
    those that are whole turns apart one."""
    aside = np.random.default_rng(0).uniform(-np.pi, np.pi, (_STARTS, robot.num_joints))
    starts = np.clip(start + aside, robot.lower, robot.upper)
    found = follow_poses(robot, frame, np.tile(pose, (_STARTS, 1, 1, 1)), starts)
    q = found.q[found.arrives[:, 0], 0]
    q = q[self_distance(robot, *cover, q) > 0]
    kinds = {joint.name: joint.kind for joint in robot.model.joints}
    whole = np.array([2 * np.pi * (kinds[name] == "revolute") for name in robot.joint_names])
    kept: list[np.ndarray] = []
    for posture in q[np.argsort(np.linalg.norm(q - start, axis=1))]:
        ways = [posture - other for other in kept]
        if all(np.abs(way - whole * np.round(way / (2 * np.pi))).max() > _SAME for way in ways):
            kept.append(posture)
    return kept
