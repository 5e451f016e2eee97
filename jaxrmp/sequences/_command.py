"""What a state's policy asks for, and what its guard looks at, in one call."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import length, matmul
from .._rotations import rotation_angle
from ..kinematics import Robot, forward_kinematics
from ..simulation._step import Motion, command, euler
from ..world import World
from ._advance import Observation
from ._sequence import Aim


class Asked(NamedTuple):
    """At a state of the joints: the `energy` and the accelerations `qdd` [n] of a policy, and of an aim the `distance`
    that is left, m, the rotation `R` [3, 3] that is, and its `speed`, m/s."""

    energy: jax.Array
    qdd: jax.Array
    distance: jax.Array
    R: jax.Array
    speed: jax.Array

    def seen(self, time: float) -> Observation:
        """What guards look at, at `time`, s."""
        return Observation(time, float(self.distance), float(rotation_angle(np.asarray(self.R))), float(self.speed))


@jax.jit
def ask(policy: Any, robot: Robot, aim: Aim | None, T: jax.Array, world: World, q: jax.Array, qd: jax.Array) -> Asked:
    """What a `policy` with its target at `T` [4, 4] asks of a `robot` at `q`, `qd` [n], and how far its `aim` is."""
    found = command(policy.tree(T, world), q, qd)
    return Asked(found.energy, found.qdd, *_left(robot, aim, T, q, qd))


@partial(jax.jit, static_argnames="steps")
def follow(policy, robot, aim, T, world, motion: Motion, dt, steps: int) -> tuple[Motion, jax.Array, Asked]:
    """`steps` of a policy, kinematically: the motion then, the energy before each, and how far the aim is then."""
    tree = policy.tree(T, world)

    def step(motion, _):
        found = command(tree, motion.q, motion.qd)
        return euler(motion, found.qdd, dt), found.energy

    motion, energies = jax.lax.scan(step, motion, length=steps)
    zero = jnp.zeros((), motion.q.dtype)
    return motion, energies, Asked(zero, motion.qd, *_left(robot, aim, T, motion.q, motion.qd))


def _left(robot, aim, T, q, qd):
    zero = jnp.zeros((), q.dtype)
    if aim is None:
        return zero + jnp.inf, jnp.eye(3, dtype=q.dtype), zero

    def place(q):
        at = forward_kinematics(robot, q, aim.frame)
        return matmul(at[:3, :3], jnp.asarray(aim.point, q.dtype)) + at[:3, 3], at[:3, :3]

    (p, R), (pd, _) = jax.jvp(place, (q,), (qd,))
    wanted = matmul(jnp.asarray(T, q.dtype), jnp.asarray(aim.T_target_aim, q.dtype))
    off = matmul(wanted[:3, :3].T, R) if aim.turned else jnp.eye(3, dtype=q.dtype)
    return length(p - wanted[:3, 3]), off, length(pd)
