"""The posture to wait in, for a robot of which none is known: which of many random ones a hand gets around from best.

In NumPy: a look at a few thousand postures, for which compiling would take longest.
"""

from typing import Any

import numpy as np

from .._errors import ConfigurationError, ShapeError
from ..kinematics import Robot
from ..kinematics._arranged import pose_of
from ..kinematics._body_poses import body_poses
from ..world import RobotSpheres, own_self_pairs
from ..world._self_clearance import height_above, self_distance
from ._lean_spheres import lean
from ._posture_search import TURN_LENGTH

_POSTURES, _RESTS, _PARTS = 1024, 32, 12  # looked at; the best of them, and ways from each; postures on a way
_MARGIN = 0.08  # of a joint's range, that is kept from its limits
_APART = 0.005  # m, that spheres are apart
_POOR = 0.05  # the share of random postures that a given one is better conditioned than, or else it is not kept
_STEP = 1e-5  # rad or m


def find_rest(
    robot: Robot,
    hands: str | tuple[str, ...],
    spheres: RobotSpheres | None = None,
    pairs: Any = None,
    *,
    own: Any = None,
    seed: int | np.random.Generator = 0,
) -> np.ndarray:
    """Where the joints of a `robot` had best rest, for its `hands` to get anywhere from there.

    Of the best conditioned of random postures clear of the robot itself, that from which most straight ways in joint
    space to others are clear too. Where enough are, all stay above the base, along its z axis, as if it stood on a
    table, or was mounted on a wall. How well a posture is conditioned, is the least singular value of the hands'
    Jacobian, turns counted at an arm of 0.2 m, or left out where joints are too few to turn all hands at will.
    Joints that move no hand stay in the middle of their range.

    **Arguments**: `spheres` that cover the robot, None to look at no clearance; `pairs` of them that must not touch, by
    default `own_self_pairs`; `own` [n], rad or m, a posture that is returned as it is if it is clear and better
    conditioned than a twentieth of random ones, or if none of those is clear; `seed`, or a generator, of the random.
    **Returns** the posture [n]. **Raises** `ConfigurationError` if no random posture is clear, `UnknownNameError` for a
    frame that is not there, `ShapeError` for another `own`.
    """
    hands = (hands,) if isinstance(hands, str) else tuple(hands)
    moving = spheres
    if spheres is not None:
        moving, spheres, pairs = lean(robot, spheres, own_self_pairs(robot, spheres) if pairs is None else pairs)
    given = robot.middle if own is None else np.asarray(own, float)
    if given.shape != (robot.num_joints,):
        raise ShapeError(f"own has shape {given.shape}, expected ({robot.num_joints},): a position of each joint.")
    q = np.concatenate([given[None], _random(robot, np.random.default_rng(seed))])
    J = _jacobians(robot, hands, q)
    moved = np.abs(J).max(axis=(0, 1)) > 1e-6
    q[1:, ~moved] = robot.middle[~moved]
    quality = _quality(J[..., moved], len(hands))
    apart = _apart(robot, spheres, pairs, q)
    clear = apart[1:] > _APART
    if own is not None and (not clear.any() or (apart[0] > 0 and quality[0] > np.quantile(quality[1:], _POOR))):
        return given
    if not clear.any():
        raise ConfigurationError(
            f"no random posture of {robot.name!r} is clear of the robot itself: its spheres are too coarse. Give "
            "others, or a rest posture of your own."
        )
    high = clear & (_height(robot, moving, np.argmax(moved), q[1:]) > 0)
    clear = high if high.sum() >= _RESTS else clear
    q, quality = q[1:][clear], quality[1:][clear]
    rests, ends = q[np.argsort(-quality)[:_RESTS]], q[:_RESTS]
    parts = np.linspace(0, 1, _PARTS + 1)[1:, None, None]
    ways = [_apart(robot, spheres, pairs, (rest + parts * (ends - rest)).reshape(-1, len(rest))) for rest in rests]
    free = [(way.reshape(_PARTS, -1).min(axis=0) > 0).mean() for way in ways]
    return rests[int(np.argmax(free))]


def _random(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Postures within the limits, and one turn at most about the middle of them, [N, n]."""
    middle, half = robot.middle, np.minimum((np.asarray(robot.upper) - np.asarray(robot.lower)) / 2, np.pi)
    return middle + (1 - 2 * _MARGIN) * half * rng.uniform(-1, 1, (_POSTURES, robot.num_joints))


def _jacobians(robot: Robot, hands: tuple[str, ...], q: np.ndarray) -> np.ndarray:
    """Of the hands' positions, m, and axes, times the length that turns count at, by differences: [N, 12 H, n]."""
    frames = [robot.model.frames[robot.frame_index(hand)] for hand in hands]

    def places(q):
        poses = body_poses(robot.model, q)
        T = np.stack([poses[frame.body] @ pose_of(frame) for frame in frames], axis=1)[:, :, :3]
        return np.concatenate([T[..., 3:].swapaxes(2, 3), TURN_LENGTH / np.sqrt(2) * T[..., :3]], axis=2)

    steps = _STEP * np.eye(robot.num_joints)
    slopes = [(places(q + step) - places(q - step)) / (2 * _STEP) for step in steps]
    return np.stack(slopes, axis=-1).reshape(len(q), -1, robot.num_joints)


def _quality(J: np.ndarray, hands: int) -> np.ndarray:
    """The least singular value of Jacobians [N, 12 H, n], of those that there can be, [N]."""
    n = J.shape[-1]
    turned = n >= 6 * hands
    J = J if turned else J.reshape(len(J), hands, 4, 3, n)[:, :, 0].reshape(len(J), -1, n)
    return np.linalg.svd(J, compute_uv=False)[:, min(n, (6 if turned else 3) * hands) - 1]


def _apart(robot: Robot, spheres: RobotSpheres | None, pairs: Any, q: np.ndarray) -> np.ndarray:
    """How far the closest pair of spheres is apart in each of postures [N, n], m."""
    if spheres is None or not pairs:
        return np.full(len(q), np.inf)
    return self_distance(robot, spheres, pairs, q)


def _height(robot: Robot, spheres: RobotSpheres | None, joint: int, q: np.ndarray) -> np.ndarray:
    """How far the lowest of moving spheres is above the base, what carries `joint`, in postures [N, n], m."""
    if spheres is None or not spheres.size:
        return np.full(len(q), np.inf)
    moved = next(j.body for j in robot.model.joints if j.coordinate == joint)
    return height_above(robot, spheres, robot.model.bodies[moved].parent, q)
