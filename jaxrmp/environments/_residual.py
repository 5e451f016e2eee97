"""A policy as a controller, to whose accelerations an action adds: for learning what the policy cannot do by itself."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._certificate import Certificate, uncertified_leaves
from .._errors import ConfigurationError, ShapeError
from .._linalg import length as length_of
from .._linalg import matmul
from .._pytree import pytree, static
from .._ranges import FINITE, Finite, NonNegative, Positive, require_number
from ..kinematics import forward_kinematics
from ..policies import ArmPolicy
from ..simulation import Motion, euler, within_velocity_limits
from ..simulation._step import Command, command
from ..world import ObstacleDistances, World

RESIDUAL = "residual"
"""What a certificate names as the leaf that voids it."""
_FAR = 1.0  # clearances beyond are not told, m


class Told(NamedTuple):
    """What a step was like, for rewards and for `info`.

    `distance`, of the hands to their goals after it, the farthest, m; `clearance`, of the arm to obstacles, at most 1
    m, and that where there are none; `touched`, whether that was 0 or less; `energy`, V of the policy; `put_in`, how
    much energy what was added to the policy has put in since the start of the episode: V falls by what the policy
    dissipates, and rises by this; `taken_out`, how much it took out; `action` [n], as it was taken.
    """

    distance: jax.Array
    clearance: jax.Array
    touched: jax.Array
    energy: jax.Array
    put_in: jax.Array
    taken_out: jax.Array
    action: jax.Array


class EnvironmentState(NamedTuple):
    """Of an episode: the `motion` of the joints, what the policy gives there, `asked`, its target `T_world_target`, the
    `steps` so far, whether it is `over`, `put_in` and `taken_out` as `Told` has them, and the `key` of the next one."""

    motion: Motion
    asked: Command
    T_world_target: jax.Array
    steps: jax.Array
    over: jax.Array
    put_in: jax.Array
    taken_out: jax.Array
    key: jax.Array


class Transition(NamedTuple):
    """What a step gives: the `state` after it and what is seen of it, `observation`; `reward`; whether the episode
    ended, `terminated`, or was cut, `truncated`; and what there is to tell, `told`."""

    state: EnvironmentState
    observation: jax.Array
    reward: jax.Array
    terminated: jax.Array
    truncated: jax.Array
    told: Told


def sooner(told: Told) -> jax.Array:
    """The reward of being near: minus the distance, m, and minus ten more for what was `told` to be touched."""
    return -told.distance - 10.0 * told.touched


@pytree
class ResidualEnvironment:
    """An arm that moves kinematically by `policy`, an `ArmPolicy`, and by an action that adds to its accelerations.

    An action [n] in [-1, 1] is `largest` [n], rad/s^2, at 1; the sum is cut at `acceleration_limit` [n], rad/s^2, and
    at the velocity limits of the robot. An episode begins at rest within `spread`, rad, of `start` [n], with the target
    at `T_world_target` [4, 4] moved by up to `target_spread` [3], m, among the obstacles of `world`; it ends when one
    is touched, and is cut after `length` steps of `dt` seconds, of `substeps` calls of the policy each. `reward` is a
    function of a `Told`. All but the last four are parameters: a moved obstacle compiles nothing.

    A residual breaks the certificate of the policy, whatever it is learned to be: `residual_certificate` says so, and
    `Told.put_in` how much energy it has put in.

    **Raises** `ConfigurationError` for times or limits that make no sense, or obstacles for a policy without spheres,
    which would touch them unnoticed.
    """

    policy: ArmPolicy
    start: Finite[jax.Array]
    T_world_target: Finite[jax.Array]
    world: World
    largest: Finite[jax.Array]
    acceleration_limit: Positive[jax.Array]
    spread: NonNegative[Any] = 0.0
    target_spread: NonNegative[Any] = 0.0
    reward: Callable[[Told], jax.Array] = static(default=sooner)
    length: int = static(default=200)
    dt: float = static(default=0.02)
    substeps: int = static(default=10)

    def __post_init__(self):
        if self.length < 1 or self.substeps < 1 or not 0 < self.dt < np.inf:
            raise ConfigurationError(
                f"length is {self.length!r}, substeps {self.substeps!r} and dt {self.dt!r}: expected positive numbers."
            )
        if self.world.size and not _watched(self.policy, self.world):
            raise ConfigurationError(
                f"world has {self.world.size} slots for obstacles and the policy no spheres, so that touching them "
                "goes unnoticed: give spheres to reaching_policy or whole_arm_policy, or World()."
            )

    @property
    def joints(self) -> int:
        """Number n of joints, of the start and of an action."""
        return self.policy.robot.num_joints

    @property
    def size(self) -> int:
        """Numbers of an observation: positions, velocities, the policy's own accelerations over their limit, from each
        hand to its goal, m, and the clearance, m."""
        return 3 * self.joints + 3 * len(_hands(self.policy, self.T_world_target)) + 1


def reset(environment: ResidualEnvironment, key: jax.Array) -> tuple[EnvironmentState, jax.Array]:
    """The first state of an episode of an `environment`, drawn by `key`, and what is seen of it [size].

    **Raises** `ShapeError` for fields of other shapes than `ResidualEnvironment` says.
    """
    n = environment.joints
    shapes = {"start": [(n,)], "largest": [(n,)], "acceleration_limit": [(n,)]}
    for name, expected in (shapes | {"spread": [(), (n,)], "target_spread": [(), (3,)]}).items():
        _check_shape(name, getattr(environment, name), expected)
    key, of_start, of_target = jax.random.split(key, 3)
    q = jnp.asarray(environment.start, jnp.float32)
    q = q + environment.spread * jax.random.uniform(of_start, q.shape, q.dtype, -1.0, 1.0)
    q = jnp.clip(
        q, *(jnp.asarray(a, q.dtype) for a in (environment.policy.robot.lower, environment.policy.robot.upper))
    )
    T = jnp.asarray(environment.T_world_target, q.dtype)
    moved = environment.target_spread * jax.random.uniform(of_target, (3,), q.dtype, -1.0, 1.0)
    T = T.at[..., :3, 3].add(moved)
    zero, motion = jnp.zeros((), q.dtype), Motion.at_rest(q)
    asked = command(environment.policy.tree(T, environment.world), motion.q, motion.qd)
    state = EnvironmentState(motion, asked, T, jnp.zeros((), int), jnp.zeros((), bool), zero, zero, key)
    return state, _observe(environment, state)


def step(environment: ResidualEnvironment, state: EnvironmentState, action: jax.Array) -> Transition:
    """A step of an `environment` from `state`, with an `action` [n], which is cut to [-1, 1].

    **Raises** `ShapeError` for an action of another shape, `ConfigurationError` for one that is not finite.
    """
    action = _cut(environment, state, action)
    h, tree = environment.dt / environment.substeps, environment.policy.tree(state.T_world_target, environment.world)

    def substep(carried, _):
        motion, asked, put_in, taken_out = carried
        applied = _applied(environment, motion, asked.qdd, action)
        power = jax.jvp(lambda qd: tree.energy(motion.q, qd), (motion.qd,), (applied - asked.qdd,))[1]
        put_in, taken_out = put_in + h * jnp.maximum(power, 0), taken_out + h * jnp.maximum(-power, 0)
        motion = euler(motion, applied, h)
        return (motion, command(tree, motion.q, motion.qd), put_in, taken_out), None

    start = state.motion, state.asked, state.put_in, state.taken_out
    (motion, asked, put_in, taken_out), _ = jax.lax.scan(substep, start, length=environment.substeps)
    clearance = _clearance(environment, motion.q)
    touched = (clearance <= 0) | ~jnp.isfinite(motion.q).all()
    truncated = (state.steps + 1 >= environment.length) & ~touched
    moved = {"motion": motion, "asked": asked, "put_in": put_in, "taken_out": taken_out}
    ahead = state._replace(**moved, steps=state.steps + 1, over=touched | truncated)
    off = jnp.stack([length_of(off) for off in _off(environment, ahead)] or [jnp.zeros((), motion.q.dtype)])
    told = Told(off.max(), clearance, touched, asked.energy, put_in, taken_out, action)
    return Transition(ahead, _observe(environment, ahead), environment.reward(told), touched, truncated, told)


def step_or_reset(environment: ResidualEnvironment, state: EnvironmentState, action: jax.Array) -> Transition:
    """As `step`, but after the last step of an episode of an `environment` another begins, by the `key` in `state`: its
    `action` counts for nothing then, and nothing is rewarded. **Raises** as both."""
    ahead = step(environment, state, action)
    first, seen = reset(environment, state.key)
    zero, no = jnp.zeros_like(ahead.reward), jnp.zeros((), bool)
    anew = Transition(first, seen, zero, no, no, ahead.told)
    return jax.tree.map(lambda a, b: jnp.where(state.over, a, b), anew, ahead)


def residual_certificate(environment: ResidualEnvironment, state: EnvironmentState, action: jax.Array) -> Certificate:
    """The certificate of the policy of an `environment` at `state`, with an `action` [n]: voided by the residual.

    `dV_dt` is that of the motion as it is moved: where it is above minus the `dissipation`, energy is put in.
    **Raises** as `step`.
    """
    tree, motion = environment.policy.tree(state.T_world_target, environment.world), state.motion
    found = tree.measure(motion.q, motion.qd)
    applied = _applied(environment, motion, state.asked.qdd, _cut(environment, state, action))
    _, rate = jax.jvp(tree.energy, (motion.q, motion.qd), (motion.qd, applied))
    return Certificate(found.energy, rate, found.dissipation, (*uncertified_leaves(tree), RESIDUAL))


def check_action(name: str, action: Any, shape: tuple[int, ...]) -> None:
    """**Raises** `ShapeError` for an `action` of another `shape`, `ConfigurationError` for one that is not finite."""
    _check_shape(name, action, [shape])
    require_number("step", name, action, FINITE)


def _check_shape(name: str, value: Any, expected: list[tuple[int, ...]]) -> None:
    if np.shape(value) not in expected:
        raise ShapeError(f"{name} has shape {np.shape(value)}, expected {' or '.join(map(str, expected))}.")


def _cut(environment, state, action):
    check_action("action", action, (environment.joints,))
    return jnp.clip(jnp.asarray(action, state.motion.q.dtype), -1.0, 1.0)


def _watched(policy: ArmPolicy, world: World) -> bool:
    """Whether there is something to keep off, and something that can touch it."""
    return bool(policy.spheres is not None and policy.spheres.size and world.size)


def _applied(environment, motion, asked, action):
    limit, most = (jnp.asarray(a, asked.dtype) for a in (environment.acceleration_limit, environment.largest))
    wanted = jnp.clip(asked + most * action, -limit, limit)
    return within_velocity_limits(wanted, motion.qd, jnp.asarray(environment.policy.robot.velocity_limit, asked.dtype))


def _hands(policy, T):
    found = [getattr(task, "hand", lambda T: None)(at) for task, at in policy.with_targets(T)]
    return [hand for hand in found if hand is not None]


def _off(environment, state):
    """From each hand to its goal, [3] each, m."""
    q, off = state.motion.q, []
    for frame, offset, goal in _hands(environment.policy, state.T_world_target):
        at = forward_kinematics(environment.policy.robot, q, frame)
        off.append(jnp.asarray(goal, q.dtype) - at[:3, 3] - matmul(at[:3, :3], jnp.asarray(offset, q.dtype)))
    return off


def _clearance(environment, q):
    policy = environment.policy
    if not _watched(policy, environment.world):
        return jnp.full((), _FAR, q.dtype)
    distances = ObstacleDistances(policy.spheres.points(policy.robot), environment.world, policy.spheres.radii)(q)
    return jnp.minimum(distances.min(), _FAR)


def _observe(environment, state):
    motion, asked = state.motion, state.asked.qdd
    limit = jnp.asarray(environment.acceleration_limit, asked.dtype)
    clearance = _clearance(environment, motion.q)[None]
    return jnp.concatenate([motion.q, motion.qd, asked / limit, *_off(environment, state), clearance])
