"""Damping of every joint, with a constant metric."""

import jax
import jax.numpy as jnp

from .._gds import SeparableGDS
from .._pytree import pytree, static


@pytree
class JointDamping(SeparableGDS):
    """Slows every coordinate down, and gives the root a metric in directions that no task takes.

    `M = w I`, `B = eta w I`, no potential: alone, `xdd = -eta xd`.

    **Arguments**: `weight` w, the metric, as importance per coordinate, a number or [m]; `damping_rate` eta, per
    second, a number or [m]. A weight of about 1e-3 next to tasks of weight 1 keeps the null space still and the root
    metric invertible without being felt elsewhere.

    RMPflow (Cheng et al. 2018), damper.
    """

    weight: jax.Array | float = 1e-3
    damping_rate: jax.Array | float = 1.0
    name: str = static(default="joint_damping")

    def metric(self, x, xd):
        return jnp.broadcast_to(jnp.asarray(self.weight, x.dtype), x.shape)

    def potential(self, x):
        return jnp.zeros_like(x)

    def damping(self, x, xd):
        return (self.damping_rate * self.metric(x, xd)).astype(x.dtype)
