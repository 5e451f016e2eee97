"""A distance that is to be kept."""

import jax

from .._gds import SeparableGDS
from .._pytree import pytree, static
from .._ranges import NonNegative


@pytree
class Formation(SeparableGDS):
    """Keeps distances: draws every coordinate `x = |y - c| - distance` of its space to zero.

    `M = w I`, `Phi = 1/2 gain w x^2`, `B = damping_rate w I`: alone, `xdd = -gain x - damping_rate xd`. The space is
    the range of `Distance(c, distance)`, for a fixed point c, or, for two points that move, of
    `compose(RelativePoints(a, b), Pointwise(Distance(jnp.zeros(3), distance)))` with this leaf in a `Batched` node.
    At `y = c` itself, where no direction is better than another, `Distance` gives it no force.

    **Arguments**: `weight` w, the metric; `gain`, 1/s^2; `damping_rate`, 1/s; numbers or [m].
    **Raises** `ConfigurationError` for a negative parameter.

    >>> import jax.numpy as jnp
    >>> Formation(gain=4.0)(jnp.array([0.5]), jnp.zeros(1)).f.tolist()
    [-2.0]

    Li et al. 2019, multi-robot RMPflow, distance preservation.
    """

    weight: NonNegative[jax.Array | float] = 1.0
    gain: NonNegative[jax.Array | float] = 1.0
    damping_rate: NonNegative[jax.Array | float] = 2.0
    name: str = static(default="formation")
    has_goal = True

    def potential(self, x):
        return (0.5 * self.gain * self.weight * x * x).astype(x.dtype)
