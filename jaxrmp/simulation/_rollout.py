"""What a simulation gives."""

import jax

from .._pytree import pytree, static


@pytree
class Rollout:
    """States along a rollout of T steps, the first being the start.

    `time` [T] s, `q` [T, n], `qd` [T, n] per second, `energy` [T], the tree's Lyapunov function, `gap` [T, G], the
    distance left to each of the tree's goals, in units of the leaf's space, and `goals`, the names of those leaves (see
    `inspection.goals`). `arrival(path)` says how it ended.
    """

    time: jax.Array
    q: jax.Array
    qd: jax.Array
    energy: jax.Array
    gap: jax.Array
    goals: tuple[str, ...] = static()
