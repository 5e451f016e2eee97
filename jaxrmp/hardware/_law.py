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
from ._limits import Limited, brake, check_limits, limited


class Step(NamedTuple):
    """What a law gives at a state: the next command `qd` and `qdd` [n]; `wanted` [n], what the policy asked for;
    `cut` [n], what the limits took of that; `energy` V and its `dissipation` per second, in the policy's own time."""

    qd: Any
    qdd: Any
    wanted: Any
    cut: Any
    energy: Any
    dissipation: Any


class Law(NamedTuple):
    """Two compiled functions, and what they are.

    `step(T, spheres, q, qd, last, speed)`, of where the object is [4, 4], the obstacles, joint positions, and velocity
    and acceleration of the last command [n], gives a `Step`; `brake(q, qd, last)` gives a `Limited`. `obstacles`, how
    many slots there are; `backend`, "c" or "xla", and `reason`, why it is not C; `uncertified`, names of leaves that
    void the certificate.
    """

    step: Callable[..., Step]
    brake: Callable[..., Limited]
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
        raise ConfigurationError(f"the policy is for {policy.robot.num_joints} joints, and {arm.name} has {n}.")
    limits = single(check_limits(arm.limits, n))
    period = np.float32(arm.period)
    policy = policy if jax.tree_util.all_leaves([policy]) else single(policy)
    slots = single(Spheres.of([], capacity=obstacles)) if obstacles else None

    def step(T: Any, spheres: Any, q: Any, qd: Any, last: Any, speed: Any) -> Step:
        found = policy.tree(T, World(spheres=spheres)).measure(q, qd / speed)
        wanted = speed * speed * resolve(found.form.dense())
        given = limited(limits, q, qd, last, wanted, period)
        return Step(given.qd, given.qdd, wanted, given.cut, found.energy, found.dissipation)

    def stopping(q: Any, qd: Any, last: Any) -> Limited:
        return brake(limits, q, qd, last, period)

    vector, T = np.zeros(n, np.float32), np.eye(4, dtype=np.float32)
    slots = jax.tree.map(np.asarray, slots)
    steps = (step, T, slots, vector, vector, vector, np.float32(1.0))
    brakes = (stopping, vector, vector, vector)
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
