"""A policy as an arm's control law: one compiled function from a state to the next command within the arm's limits."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._certificate import uncertified_leaves
from .._errors import ConfigurationError, ExportError
from .._forms import resolve
from .._pytree import single
from ..world import Spheres, World
from ..xla import compiled
from ._arm import Arm
from ._limits import Limited, MotionLimits, brake, check_limits, limited

# How velocities mend what the arm is off its reference: at a rate of 1/s, at most so fast, and with such accelerations,
# in rad (m) and as shares of the arm's limits, of which the reference leaves them that much.
_NEARING = 4.0
_NEAREST, _OF_VELOCITY = 0.1, 0.04
_NEARER, _OF_ACCELERATION, _OF_JERK = 0.5, 0.08, 0.1
_FAR = 1e3  # rad, from the end of a range that a joint does not move to
_NEXT_TO_NOTHING = 0.01  # of an acceleration


class Step(NamedTuple):
    """What a law gives in a cycle, besides `Looked`: the reference's next velocity `qd` and acceleration `qdd` [n]; the
    velocities to send, `command` [n], which mend by `drift` [n] what the arm has drifted from the reference; `wanted`
    [n], what the policy asked for; `energy` V and its `dissipation` per
    second, in the policy's own time. Of a law that brakes, NaN where the policy was not asked. `looked`, for a
    watch."""

    qd: Any
    qdd: Any
    command: Any
    drift: Any
    wanted: Any
    energy: Any
    dissipation: Any
    looked: "Looked"


class Looked(NamedTuple):
    """What a watch looks at: `finite`, whether all of the policy is; `apart`, the largest distance of a joint from its
    reference, and `end`, the least to the end of a range that a joint moves to, rad; `fastest`, rad/s, of the
    reference, and `sent`, of the command; `free`, whether limits took next to nothing."""

    finite: Any
    apart: Any
    end: Any
    fastest: Any
    sent: Any
    free: Any


class Law(NamedTuple):
    """Two compiled functions, `step` and `brake`, and what they are.

    `step(T, spheres, q, measured, qd, last, drift, speed)`, of where the object is [4, 4], the obstacles, the reference
    and the joints as measured, and the last step's `qd`, `qdd` and `drift` [n], gives a `Step`; so does
    `brake(q, measured, qd, last, drift)`. `obstacles`, how many slots there are; `backend`, "c" or "xla", and `reason`,
    why it is not C; `uncertified`, names of leaves that void the certificate.
    """

    step: Callable[..., Step]
    brake: Callable[..., Step]
    obstacles: int
    backend: str
    reason: str
    uncertified: tuple[str, ...]


def law(policy: Any, arm: Arm, obstacles: int = 0, backend: str = "auto") -> Law:
    """Compile a `policy` for an `arm`: some seconds, before it moves.

    A policy at speed s passes the same places s times as fast: `qdd = s^2 policy(q, qd / s)`.

    **Arguments**: `policy`, such as a `policies.ArmPolicy`: what has `robot` and `tree(T_world_target, world)`;
    `obstacles`, slots for spheres that it keeps off; `backend`, "c", "xla", or "auto": C where there is a compiler.
    **Raises** `ConfigurationError` for a policy of another number of joints, `ExportError` for a `backend` of "c" that
    cannot be had, else as `policy.tree`.
    """
    n = arm.joints
    if policy.robot.num_joints != n:
        raise ConfigurationError(
            f"the policy is for {policy.robot.name!r} of {policy.robot.num_joints} joints, and {arm.name} has {n}."
        )
    limits = single(check_limits(arm.limits, n))
    period = np.float32(arm.period)
    policy = policy if jax.tree_util.all_leaves([policy]) else single(policy)
    slots = single(Spheres.of([], capacity=obstacles)) if obstacles else None

    def step(T: Any, spheres: Any, q: Any, measured: Any, qd: Any, last: Any, drift: Any, speed: Any) -> Step:
        found = policy.tree(T, World(spheres=spheres)).measure(q, qd / speed)
        wanted = speed * speed * resolve(found.form.dense())
        given = limited(limits, q, qd, last, wanted, period)
        drift = mended(limits, q, given.qd, drift, _NEARING * (q - measured), period)
        return _step(limits, q, measured, given, drift, wanted, found.energy, found.dissipation)

    def stopping(q: Any, measured: Any, qd: Any, last: Any, drift: Any) -> Step:
        given = brake(limits, q, qd, last, period)
        nothing = jnp.full_like(q, jnp.nan)
        drift = mended(limits, q, given.qd, drift, jnp.zeros_like(q), period)
        return _step(limits, q, measured, given, drift, nothing, nothing[0], nothing[0])

    vector, T = np.zeros(n, np.float32), np.eye(4, dtype=np.float32)
    slots = jax.tree.map(np.asarray, slots)
    steps = (step, T, slots, *(vector,) * 5, np.float32(1.0))
    brakes = (stopping, *(vector,) * 5)
    names = tuple(uncertified_leaves(policy.tree(jnp.asarray(T), World(spheres=slots))))
    reason = ""
    if backend != "xla":
        try:
            return Law(compiled(*steps, backend="c"), compiled(*brakes, backend="c"), obstacles, "c", "", names)
        except ExportError as error:
            if backend == "c":
                raise
            reason = str(error)
    return Law(compiled(*steps), compiled(*brakes), obstacles, "xla", reason, names)


def mended(limits: MotionLimits, q: Any, qd: Any, drift: Any, wanted: Any, period: Any) -> Any:
    """`drift` [n], velocities that mend what an arm has drifted from its reference at `q` and `qd`, on its way to those
    `wanted`, so that both together keep the arm's limits."""
    most = jnp.minimum(_NEAREST, _OF_VELOCITY * limits.velocity)
    change = jnp.minimum(_NEARER, jnp.minimum(_OF_ACCELERATION * limits.acceleration, _OF_JERK * limits.jerk * period))
    new = drift + jnp.clip(jnp.clip(wanted, -most, most) - drift, -change * period, change * period)
    low, high = limits.velocity_range(q)
    return jnp.clip(new, jnp.minimum(low - qd, 0.0), jnp.maximum(high - qd, 0.0))


def _step(
    limits: MotionLimits,
    q: Any,
    measured: Any,
    given: Limited,
    drift: Any,
    wanted: Any,
    energy: Any,
    dissipation: Any,
) -> Step:
    command = given.qd + drift
    finite = jnp.isfinite(given.qd).all() & jnp.isfinite(wanted).all() & jnp.isfinite(energy)
    far = jnp.full_like(q, _FAR)
    low = jnp.where(given.qd < 0, q - limits.lower, far)
    high = jnp.where(given.qd > 0, limits.upper - q, far)
    free = jnp.abs(given.cut).max() <= _NEXT_TO_NOTHING * (1.0 + jnp.abs(wanted).max())
    fastest, sent = jnp.abs(given.qd).max(), jnp.abs(command).max()
    looked = Looked(finite, jnp.abs(q - measured).max(), jnp.minimum(low, high).min(), fastest, sent, free)
    return Step(given.qd, given.qdd, command, drift, wanted, energy, dissipation, looked)
