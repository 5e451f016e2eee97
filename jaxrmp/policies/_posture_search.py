"""The posture for a goal: which of many joint positions that bring hands to poses a policy had best be drawn to."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, ShapeError
from .._linalg import cholesky_solve, einsum, matmul
from ..kinematics import Robot, frame_poses
from ..world import ObstacleDistances, RobotSpheres, SelfDistances, World, own_self_pairs

SHARE = 0.02  # of a joint's range, that postures keep from its limits
TURN_LENGTH = 0.2  # m, that a turn of one radian counts as, against metres
_SEEN = 24  # postures on the straight way from the rest that are looked at
_OFF = 0.02  # m: obstacles and spheres that are closer are in the way
_APART = 0.005  # m: of postures that are closer to touching, the less close ones are better
_CLOSE = 1e-3  # m, and rad times TURN_LENGTH: at the goal


class FoundPosture(NamedTuple):
    """The best posture for a goal: `q` [n], rad or m; `position_error` and `turn_error`, how far the worst hand is from
    its pose there, m and rad; `clearance`, the least distance to obstacles and of the robot's own spheres, m, infinite
    where nothing is to be kept off, or 1000 where all slots of a world are empty."""

    q: jax.Array
    position_error: jax.Array
    turn_error: jax.Array
    clearance: jax.Array


def find_posture(
    robot: Robot,
    hands: str | tuple[str, ...],
    T_world_goal: jax.Array,
    rest: Any = None,
    spheres: RobotSpheres | None = None,
    world: World | None = None,
    pairs: Any = None,
    *,
    turned: bool = True,
    starts: int = 256,
    iterations: int = 60,
) -> FoundPosture:
    """Where the joints of a `robot` had best be, for its `hands` to be at a pose, or at one each.

    Inverse kinematics by `iterations` of Levenberg and Marquardt's method, from `starts` postures spread over the joint
    range; of the results that are at the goal, the one that is clear, and to which the straight way from `rest` in
    joint space is clearest and shortest. Pure: for `jax.jit`, and for `jax.vmap` over goals, rests and worlds.

    **Arguments**: `T_world_goal` [4, 4] for one hand, [H, 4, 4] for several, m; `rest` [n], by default the `middle`;
    `spheres` that cover the robot, not to touch each other and the obstacles of `world`; `pairs` of them that must not
    touch, by default `own_self_pairs`; `turned`, False where the turn of the hands is free.
    **Returns** a `FoundPosture`; whether it is at the goal, its errors say.
    **Raises** `UnknownNameError` for frames that are not there, `ShapeError` for other shapes,
    `ConfigurationError` for numbers that make no sense.
    """
    hands = (hands,) if isinstance(hands, str) else tuple(hands)
    shape, rest = np.shape(T_world_goal), robot.middle if rest is None else rest
    posed = shape == (len(hands), 4, 4) or (shape == (4, 4) and len(hands) == 1)
    if not posed or np.shape(rest) != (robot.num_joints,):
        raise ShapeError(
            f"T_world_goal and rest have shapes {shape} and {np.shape(rest)}, expected a pose [4, 4] of each of "
            f"{len(hands)} hands and ({robot.num_joints},)."
        )
    if starts < 1 or iterations < 0:
        raise ConfigurationError(f"starts is {starts} and iterations {iterations}, expected 1 or more, and 0 or more.")
    goals = jnp.reshape(jnp.asarray(T_world_goal), (-1, 4, 4))
    rest = jnp.asarray(rest, goals.dtype)
    lower, upper = _inner_limits(robot, rest)
    spread = jnp.asarray(_spread(starts - 1, robot.num_joints), rest.dtype)
    begin = jnp.concatenate([jnp.clip(rest, lower, upper)[None], lower + spread * (upper - lower)])
    error = partial(_error, robot, hands, goals, turned)
    q = jax.vmap(lambda q: _solve(error, lower, upper, q, iterations))(begin)
    q = jnp.concatenate([q, jax.vmap(lambda q: _nearest_turn(robot, rest, q))(q)])
    clearance = _clearance(robot, spheres, world, pairs)
    best = q[jnp.argmin(jax.vmap(partial(_cost, error, clearance, rest, upper - lower))(q))]
    distance, turn = _errors(robot, hands, goals, best)
    return FoundPosture(best, distance, turn if turned else jnp.zeros_like(turn), clearance(best))


def _inner_limits(robot: Robot, rest: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Limits a little within the robot's, and at most a turn about `rest` for joints that turn on and on."""
    lower, upper = jnp.asarray(robot.lower, rest.dtype), jnp.asarray(robot.upper, rest.dtype)
    lower, upper = jnp.maximum(lower, rest - 2 * jnp.pi), jnp.minimum(upper, rest + 2 * jnp.pi)
    share = SHARE * (upper - lower)
    return lower + share, upper - share


def _spread(count: int, n: int) -> np.ndarray:
    """`count` points that fill the unit cube evenly, [count, n]: the additive recurrence of the plastic numbers."""
    g = 2.0
    for _ in range(64):
        g = (1 + g) ** (1 / (n + 1))
    return (0.5 + np.outer(np.arange(1, count + 1), g ** -np.arange(1.0, n + 1))) % 1.0


def _error(robot, hands, goals, turned, q):
    """What hands lack to their goals, m, turns as if at an arm of `TURN_LENGTH`: [12 H], or [3 H] if turns are free."""
    T = frame_poses(robot, q, hands)
    away = (T[:, :3, 3] - goals[:, :3, 3]).ravel()
    if not turned:
        return away
    return jnp.concatenate([away, TURN_LENGTH / jnp.sqrt(2.0) * (T[:, :3, :3] - goals[:, :3, :3]).ravel()])


def _errors(robot, hands, goals, q):
    """The worst hand's distance, m, and turn, rad, to its goal."""
    T = frame_poses(robot, q, hands)
    apart = jnp.linalg.norm(T[:, :3, :3] - goals[:, :3, :3], axis=(1, 2))
    turn = 2 * jnp.arcsin(jnp.clip(apart / jnp.sqrt(8.0), 0, 1))
    return jnp.linalg.norm(T[:, :3, 3] - goals[:, :3, 3], axis=1).max(), turn.max()


def _solve(error, lower, upper, q, iterations):
    """Levenberg and Marquardt's steps within limits, damped by the error itself (Sugihara 2011)."""

    def step(q, _):
        r, J = error(q), jax.jacfwd(error)(q)
        held = matmul(J.T, r)
        damped = matmul(J.T, J) + (0.5 * einsum("i,i->", r, r) + 1e-5) * jnp.eye(len(q), dtype=q.dtype)
        moved = jnp.clip(q - cholesky_solve(damped, held), lower, upper)
        return jnp.where(jnp.isfinite(moved), moved, q), None  # of a goal that is no number, only the errors are none

    return jax.lax.scan(step, q, length=iterations)[0]


def _nearest_turn(robot, rest, q):
    """As `q`, revolute joints by whole turns as near to `rest` as their limits allow."""
    turns = np.zeros(robot.num_joints)
    for joint in robot.model.joints:
        if joint.coordinate >= 0 and joint.kind == "revolute" and abs(joint.multiplier) == 1:
            turns[joint.coordinate] = 2 * np.pi
    lower, upper = _inner_limits(robot, rest)
    nearer = [jnp.where((p >= lower) & (p <= upper), p, q) for p in (q - turns, q + turns)]
    options = jnp.stack([q, *nearer])
    return options[jnp.argmin(jnp.abs(options - rest), axis=0), jnp.arange(len(q))]


def _clearance(robot, spheres, world, pairs):
    """From a posture to the least distance of the spheres to obstacles and to each other, m."""
    maps: list[Any] = []
    pairs = own_self_pairs(robot, spheres) if pairs is None and spheres is not None else pairs
    if spheres is not None and pairs:
        maps.append(SelfDistances(spheres.points(robot), pairs, spheres.radii))
    moving = None if spheres is None else spheres.moving(robot)
    if moving is not None and moving.size and world is not None and world.size:
        maps.append(ObstacleDistances(moving.points(robot), world, moving.radii))

    def least(q):
        return jnp.min(jnp.stack([m(q).min() for m in maps])) if maps else jnp.asarray(jnp.inf, q.dtype)

    return least


def _cost(error, clearance, rest, span, q):
    """Less is better: at the goal counts before clear, and that before a way that is clear and short. What is not at
    the goal is told apart by how far it is off."""
    r = error(q)
    off = jnp.sqrt(einsum("i,i->", r, r))
    way = rest + jnp.linspace(0, 1, _SEEN + 1, dtype=q.dtype)[1:, None] * (q - rest)
    deep = jnp.clip((_OFF - jax.lax.map(clearance, way)) / _OFF, 0, 2)
    long = jnp.linalg.norm((q - rest) / span)
    touching = jnp.clip((_APART - clearance(q)) / _APART, 0, 1)
    missed = jnp.where(off > _CLOSE, 1e3 + 1e4 * off, 0.0)
    cost = missed + 1e2 * touching + 10 * deep.mean() + long
    return jnp.where(jnp.isnan(cost), jnp.inf, cost)
