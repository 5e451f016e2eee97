"""Damping of a space, with a constant metric."""

import jax
import jax.numpy as jnp

from .._gds import SeparableGDS
from .._pytree import pytree, static
from .._ranges import NonNegative


@pytree
class Damping(SeparableGDS):
    """Slows every coordinate of its space down, and gives directions that no task takes a metric.

    `M = w I`, `B = eta w I`, no potential: alone, `xdd = -eta xd`.

    **Arguments**: `weight` w, the metric, as importance per coordinate, a number or [m]; `damping_rate` eta, per
    second, a number or [m]. On joints, a weight of about 1e-3 next to tasks of weight 1 keeps the null space still and
    the root metric invertible without being felt elsewhere.
    **Raises** `ConfigurationError` for a negative weight or rate.

    >>> Damping(weight=2.0, damping_rate=3.0)(jnp.zeros(2), jnp.ones(2)).f.tolist()
    [-6.0, -6.0]

    RMPflow (Cheng et al. 2018), damper.
    """

    weight: NonNegative[jax.Array | float] = 1e-3
    damping_rate: NonNegative[jax.Array | float] = 1.0
    name: str = static(default="damping")

    def potential(self, x):
        return jnp.zeros_like(x)
