"""Ways round obstacles: a slope that leads a hand past them, on the side that a look ahead finds to be open."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError
from .._linalg import length
from .._pytree import pytree
from .._task_map import Pushforward, TaskMap, compose
from .._tree import Node, acceleration, pullback
from ..kinematics import ControlPoints, Robot
from ..leaves import Detour
from ..world import ObstacleDistances, World
from ._joints import NOTHING

_EVERY = 10  # steps from one look at where the hand is to the next
_NEAR = 0.01  # m: what counts as arrived


@pytree
class Aside:
    """Which way round obstacles hands go: the gains of an `ArmPolicy`'s `leaves.Detour`, and a side.

    `strength`, N; `lean` [3], m, in the robot's world: hands are kept off obstacles as if they were that much farther
    on, and so pass them on that side; `reach` and `taper`, m, as the leaf has them.
    """

    strength: Any
    lean: Any
    reach: Any = 0.15
    taper: Any = 0.05


class FoundDetour(NamedTuple):
    """`aside`, for an `ArmPolicy`; `left`, how far its hand would end from its target, m, the farthest of several, and
    `clearance`, the least distance of the arm to obstacles on the way, m, infinite without spheres or obstacles."""

    aside: Aside
    left: jax.Array
    clearance: jax.Array


@pytree
class _Point(TaskMap):
    """The one point [3] of `points` [1, 3]."""

    points: ControlPoints

    def __call__(self, x):
        return self.points(x)[0]

    def pushforward(self, x, xd):
        return Pushforward(*(part[0] for part in self.points.pushforward(x, xd)))


@pytree
class _Ahead(TaskMap):
    """Of a point [3]: where it is from `goal` [3], m, and how far from each obstacle, seen `lean` [3] farther."""

    goal: Any
    lean: Any
    world: World

    def __call__(self, x):
        far = self.world.signed_distance(x + jnp.asarray(self.lean, x.dtype))
        return jnp.concatenate([x - jnp.asarray(self.goal, x.dtype), far])


def detour(robot: Robot, task: Any, T_world_target: jax.Array, world: World, aside: Aside) -> Node:
    """Leads the hand of a `task` round the obstacles of a `world`, on the way to its target at `T_world_target` [4, 4].

    **Arguments**: `robot`; `aside`, on which side, how strong and from how far on.
    `NOTHING` without obstacles, or for a task that has no method `hand(T_world_target)`, which says by the name of a
    frame, a point in it [3], m, and that point's goal [3], m, in the world, what is to go where; or says None.
    """
    hand = getattr(task, "hand", lambda T: None)(T_world_target)
    if hand is None or not world.size:
        return NOTHING
    frame, offset, goal = hand
    leaf = Detour(aside.strength, aside.reach, aside.taper)
    return pullback(compose(_point(robot, frame, offset), _Ahead(goal, aside.lean, world)), leaf)


def find_detour(
    policy: Any,
    q: Any,
    T_world_target: jax.Array,
    world: World,
    *,
    share: float = 1.2,
    reach: float = 0.15,
    lean: float = 0.05,
    duration: float = 10.0,
    dt: float = 0.005,
) -> FoundDetour:
    """The side on which the hands of an `ArmPolicy` had best pass what is in their way: found by a look ahead.

    Rolls the policy out from `q` [n] at rest, kinematically, as it is, with a detour straight away from obstacles, and
    with one that leans to each of six sides, along the axes of the robot's world. Of those that touch nothing and end
    within 1 cm of the targets, the one that is there first: the least distance left in the mean over time; if there is
    none, the one that ends nearest. It is one potential more, that stays as it is: the policy stays certified, and
    reacts as before. For `replace(policy, aside=found.aside)`; works within `jax.jit` and `jax.vmap`, compile it.

    **Arguments**: `policy`, whose own `aside` does not count; `T_world_target` and `world` as in `ArmPolicy.tree`;
    `share`, the steepest slope of the detour as a share of the tasks' pull, their energy at q over how far hands have
    to go; `reach` and `lean`, m; `duration` and `dt`, s, of the rollouts.
    **Returns** a `FoundDetour`. **Raises** `ConfigurationError` for a `dt` that is not positive, or beyond `duration`.
    """
    if not 0 < dt <= duration < np.inf:
        raise ConfigurationError(f"dt is {dt!r} and duration {duration!r}, expected seconds, 0 < dt <= duration.")
    q = jnp.asarray(q, jnp.result_type(q, jnp.float32))
    sides = np.concatenate([np.zeros((2, 3)), lean * np.eye(3), -lean * np.eye(3)])
    pull = _pull(policy, q, T_world_target)
    strengths = jnp.where(np.arange(len(sides)) > 0, share * pull, 0).astype(q.dtype)
    several = Aside(strengths, jnp.asarray(sides, q.dtype), *(jnp.asarray(g, q.dtype) for g in (reach, 0.05)))
    axes = Aside(0, 0, None, None)  # pyright: ignore[reportArgumentType]
    ahead = jax.vmap(lambda aside: _ahead(policy, aside, q, T_world_target, world, round(duration / dt), dt), (axes,))
    left, mean, clearance = ahead(several)
    cost = mean + jnp.where(left > _NEAR, 1e3 * (1 + left), 0) + jnp.where(clearance > 0, 0, 1e6)
    best = jnp.argmin(jnp.where(jnp.isfinite(cost), cost, jnp.inf))
    found = Aside(several.strength[best], several.lean[best], several.reach, several.taper)
    return FoundDetour(found, left[best], clearance[best])


def _ahead(policy, aside, q, T, world, steps, dt):
    """Distance left at the end, in the mean, and the least clearance, of a rollout from rest at `q`."""
    tree = policy.leaning(aside).tree(T, world)
    robot, spheres = policy.robot, policy.spheres
    distances = None
    if spheres is not None and spheres.size and world.size:
        distances = ObstacleDistances(spheres.points(robot), world, spheres.radii)

    def step(_, state):
        q, qd = state
        qd = qd + dt * acceleration(tree, q, qd)
        return q + dt * qd, qd

    def look(state, _):
        (q, qd), total, _, clearance = state
        q, qd = jax.lax.fori_loop(0, _EVERY, step, (q, qd))
        left = goal_distance(policy, q, T)
        clearance = clearance if distances is None else jnp.minimum(clearance, distances(q).min())
        return ((q, qd), total + left, left, clearance), None

    zero = jnp.zeros((), q.dtype)
    start = (q, jnp.zeros_like(q)), zero, zero, zero + jnp.inf
    (_, total, left, clearance), _ = jax.lax.scan(look, start, length=max(steps // _EVERY, 1))
    return left, total / max(steps // _EVERY, 1), clearance


def _pull(policy, q, T):
    """The mean force that tasks pull hands to their targets with, from `q` [n] on, N."""
    tasks = [task.tree(policy.robot, at) for task, at in policy.with_targets(T)]
    energy = sum((task.energy(q, jnp.zeros_like(q)) for task in tasks), jnp.zeros((), q.dtype))
    return energy / jnp.maximum(goal_distance(policy, q, T), _NEAR)


def goal_distance(policy: Any, q: jax.Array, T_world_target: jax.Array) -> jax.Array:
    """How far the hands of an `ArmPolicy` are from their goals at `q` [n], the farthest, m; 0 if none goes anywhere.

    **Arguments**: `policy`; `T_world_target` as in `ArmPolicy.tree`.
    """
    far = jnp.zeros((), q.dtype)
    for task, at in policy.with_targets(T_world_target):
        hand = getattr(task, "hand", lambda T: None)(at)
        if hand is not None:
            frame, offset, goal = hand
            off = _point(policy.robot, frame, offset)(q) - jnp.asarray(goal, q.dtype)
            far = jnp.maximum(far, length(off))
    return far


def _point(robot, frame, offset):
    return _Point(ControlPoints(robot, (frame,), jnp.asarray(offset)[None]))
