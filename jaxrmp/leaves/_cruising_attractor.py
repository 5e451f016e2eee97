"""Attraction to a point at a cruise speed, with a constant metric."""

import jax
import jax.numpy as jnp

from .._forms import DiagonalForm
from .._gds import GeometricDynamicalSystem
from .._linalg import matmul
from .._pytree import pytree, static
from .._ranges import Finite, NonNegative, Positive
from ._smooth_ratios import log_cosh, tanh_ratio


@pytree
class CruisingAttractor(GeometricDynamicalSystem):
    """Pulls a point straight to a goal at a cruise speed, which it gives up within a distance of it.

    With `z = x - goal`, `r = |z|`: `M = w I`, `Phi = w speed damping_rate taper log cosh(r / taper)`,
    `B = damping_rate w I`. From rest the motion stays on the straight line to the goal. Smooth at the goal. Behind a
    learned diffeomorphism it is the policy that follows demonstrations, `learning.Flow`.

    **Arguments**: `goal` [m], units of x; `weight` w, the metric; `speed`, units of x per second; `damping_rate`, 1/s;
    `taper`, within which the pull becomes a spring, units of x.
    **Raises** `ConfigurationError` for a goal that is not finite, a taper that is not positive, or another negative
    parameter.

    >>> leaf = CruisingAttractor(goal=jnp.zeros(2), speed=0.5, damping_rate=10.0)
    >>> f = leaf(jnp.array([3.0, 4.0]), jnp.array([-0.3, -0.4])).f  # at cruise speed nothing is left to do
    >>> bool(jnp.abs(f).max() < 1e-5)
    True

    Rana et al., Euclideanizing Flows (2020), section 3, the latent dynamics; here of second order.
    """

    goal: Finite[jax.Array]
    weight: NonNegative[jax.Array | float] = 1.0
    speed: NonNegative[jax.Array | float] = 0.2
    damping_rate: NonNegative[jax.Array | float] = 40.0
    taper: Positive[jax.Array | float] = 0.03
    name: str = static(default="attractor")
    has_goal = True
    _place = "goal"

    def __call__(self, x, xd):
        return self.evaluate(x, xd).dense()

    def evaluate(self, x, xd):
        z = x - jnp.asarray(self.goal, x.dtype)
        pull = self.speed / self.taper * tanh_ratio(matmul(z, z) / jnp.asarray(self.taper, x.dtype) ** 2)
        f = -self.weight * self.damping_rate * (pull * z + xd)
        return DiagonalForm(f.astype(x.dtype), jnp.broadcast_to(jnp.asarray(self.weight, x.dtype), x.shape))

    def metric(self, x, xd):
        return jnp.asarray(self.weight, x.dtype) * jnp.eye(x.shape[0], dtype=x.dtype)

    def potential(self, x):
        z = x - jnp.asarray(self.goal, x.dtype)
        well = log_cosh(matmul(z, z) / jnp.asarray(self.taper, x.dtype) ** 2)
        return (self.weight * self.speed * self.damping_rate * self.taper * well).astype(x.dtype)
