"""Joint velocity limits, as a metric that grows as a joint nears its highest speed."""

import jax
import jax.numpy as jnp

from .._gds import SeparableGDS
from .._pytree import pytree, static
from .._ranges import BelowOne, NonNegative, Positive

_LEAST = 0.05  # of 1 - e, so that the metric stays finite at the limit and constant beyond it


@pytree
class JointVelocityLimit(SeparableGDS):
    """Keeps every joint below its highest speed: near it, the joint becomes heavy and strongly damped.

    Per joint, with the share `e = (|qd| / limit - onset) / (1 - onset)` of the last stretch before the limit, held
    between 0 and 0.95: `G = weight (e / (1 - e))^2`, `B = damping_rate G`, no potential, with exact curvature
    terms. Below `onset` the leaf is not felt at all. At the limit and beyond, G is 361 weight, so a steady pull f
    is balanced by the damping below the limit as long as `f < 361 weight damping_rate limit`.

    **Arguments**: `limit`, rad/s or m/s, a number or [n], infinite where there is none; `weight`, the metric;
    `damping_rate`, 1/s, times the integration step well below one; `onset`, the share of the limit from
    which on the leaf is felt, below one. Numbers or [n].
    **Raises** `ConfigurationError` for a limit that is not positive, another negative parameter or an onset of one or
    more.

    >>> leaf = JointVelocityLimit(limit=2.0)
    >>> slow, fast = leaf(jnp.zeros(2), jnp.array([1.0, 1.9])).f
    >>> bool(slow == 0), bool(fast < -900)
    (True, True)

    This library's. Lula's `JointVelocityCap` does the same without a certificate.
    """

    limit: Positive[jax.Array | float]
    weight: NonNegative[jax.Array | float] = 1.0
    damping_rate: NonNegative[jax.Array | float] = 20.0
    onset: BelowOne[NonNegative[jax.Array | float]] = 0.7
    name: str = static(default="joint_velocity_limit")

    def metric(self, x, xd):
        e = (jnp.abs(xd) / jnp.asarray(self.limit, x.dtype) - self.onset) / (1 - self.onset)
        e = jnp.clip(e, 0, 1 - _LEAST)
        return (self.weight * (e / (1 - e)) ** 2).astype(x.dtype)

    def potential(self, x):
        return jnp.zeros_like(x)
