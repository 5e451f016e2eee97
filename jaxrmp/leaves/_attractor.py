"""Attraction to a point, isotropic."""

import jax
import jax.numpy as jnp

from .._gds import GeometricDynamicalSystem
from .._linalg import matmul
from .._pytree import pytree, static
from .._ranges import Finite, NonNegative, Positive
from ._gaussian_well import gaussian_weight, gaussian_well


@pytree
class Attractor(GeometricDynamicalSystem):
    """Pulls a point to a goal, with an importance that rises near it.

    With `z = x - goal`, `r = |z|`: `w = (weight_near - weight_far) exp(-r^2 / (2 width^2)) + weight_far`, `M = w I`,
    `grad Phi = gain w tanh(sharpness r) z / r`, `B = damping_rate w I`, and the curvature force of w. Far away it pulls
    with the acceleration `gain`, near the goal like a spring of `gain sharpness`. The potential is that force's
    integral over r (a Gauss-Legendre sum, right to rounding, whose gradient is the force exactly). Smooth at the goal.

    **Arguments**: `goal` [m], units of x; `weight_near`, `weight_far`, the metric at the goal and away from it;
    `width`, over which it changes, units of x; `sharpness`, one over the distance at which the pull becomes a spring,
    1/units of x; `gain`, units of x per second squared; `damping_rate`, 1/s.
    **Raises** `ConfigurationError` for a goal that is not finite, a width or sharpness that is not positive, or
    another negative parameter.

    >>> leaf = Attractor(goal=jnp.zeros(3), weight_near=10.0)
    >>> leaf.metric(jnp.zeros(3), jnp.zeros(3))[0].tolist()
    [10.0, 0.0, 0.0]

    RMPflow (Cheng et al. 2018), appendix on experiments, attractor.
    """

    goal: Finite[jax.Array]
    weight_near: NonNegative[jax.Array | float] = 10.0
    weight_far: NonNegative[jax.Array | float] = 1.0
    width: Positive[jax.Array | float] = 1.0
    sharpness: Positive[jax.Array | float] = 1.0
    gain: NonNegative[jax.Array | float] = 1.0
    damping_rate: NonNegative[jax.Array | float] = 2.0
    name: str = static(default="attractor")
    has_goal = True
    _place = "goal"

    def metric(self, x, xd):
        z = x - jnp.asarray(self.goal, x.dtype)
        width, near, far = _as(x.dtype, self.width, self.weight_near, self.weight_far)
        return gaussian_weight(matmul(z, z), width, near, far) * jnp.eye(x.shape[0], dtype=x.dtype)

    def potential(self, x):
        z = x - jnp.asarray(self.goal, x.dtype)
        width, sharpness, near, far = _as(x.dtype, self.width, self.sharpness, self.weight_near, self.weight_far)
        return (self.gain * gaussian_well(matmul(z, z), width, sharpness, near, far)).astype(x.dtype)


def _as(dtype, *values):
    return tuple(jnp.asarray(value, dtype) for value in values)
