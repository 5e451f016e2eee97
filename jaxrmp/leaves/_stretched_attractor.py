"""Attraction to a point, whose metric insists on the direction of the goal."""

import jax
import jax.numpy as jnp

from .._gds import GeometricDynamicalSystem
from .._linalg import matmul
from .._pytree import pytree, static
from .._ranges import Finite, NonNegative, Positive
from ._gaussian_well import gaussian_weight, gaussian_well
from ._smooth_ratios import decay_ratio


@pytree
class StretchedAttractor(GeometricDynamicalSystem):
    """Pulls a point to a goal and, far from it, leaves the sideways directions to other policies.

    With `z = x - goal`, `r = |z|` and the bumps `k(r, s) = (1 - floor) exp(-r^2 / (2 s^2)) + floor`:
    `w = (weight_near - weight_far) k(r, width) + weight_far`, `a = k(r, stretch_width)`,
    `G = w ((1 - a) z z^T / r^2 + (a + isotropy) I)`, force `-gain G tanh(sharpness r) z / r`, `B = damping_rate G`, and
    the exact curvature force of G. Smooth at the goal, where G is isotropic.

    Certified. For a metric stretched along a field of its own, G times a gradient is no gradient. Here both point along
    z: it is an eigenvector of G, so the force is `-gain (1 + isotropy) w(r) tanh(sharpness r) z / r`, a function of r
    along z, which has the potential `gain (1 + isotropy) integral of w tanh(sharpness r) dr`.

    **Arguments**: `goal` [m], units of x; `weight_near`, `weight_far`, the metric along z at the goal and away from it;
    `width`, `stretch_width`, over which weight and stretch change, units of x; `floor`, the share of the near values
    that remains far away, which bounds the stretch to about `1 / floor`; `isotropy`, added to it; `sharpness`,
    1/units of x; `gain`, units of x per second squared; `damping_rate`, 1/s.
    **Raises** `ConfigurationError` for a goal that is not finite, a width, sharpness or floor that is not positive,
    or another negative parameter.

    >>> leaf = StretchedAttractor(goal=jnp.zeros(2), weight_far=1.0, stretch_width=0.1)
    >>> along, across = jnp.diag(leaf.metric(jnp.array([9.0, 0.0]), jnp.zeros(2))).tolist()
    >>> bool(along > 100 * across)
    True

    RMPflow (Cheng et al. 2018), appendix on experiments, attractor; here with Gaussian bumps and the damping
    `damping_rate G`.
    """

    goal: Finite[jax.Array]
    weight_near: NonNegative[jax.Array | float] = 10.0
    weight_far: NonNegative[jax.Array | float] = 1.0
    width: Positive[jax.Array | float] = 1.0
    stretch_width: Positive[jax.Array | float] = 1.0
    floor: Positive[jax.Array | float] = 0.0075
    isotropy: NonNegative[jax.Array | float] = 0.0
    sharpness: Positive[jax.Array | float] = 1.0
    gain: NonNegative[jax.Array | float] = 1.0
    damping_rate: NonNegative[jax.Array | float] = 2.0
    name: str = static(default="stretched_attractor")
    has_goal = True
    _place = "goal"

    def metric(self, x, xd):
        z = x - jnp.asarray(self.goal, x.dtype)
        square = matmul(z, z)
        width, near, far = self._weights(x.dtype)
        # (1 - a) / r^2 = (1 - floor) (1 - exp(-v)) / (2 s^2 v) at v = r^2 / (2 s^2), finite at the goal.
        v = square / (2 * self.stretch_width**2)
        along = (1 - self.floor) * decay_ratio(v) / (2 * self.stretch_width**2)
        a = (1 - self.floor) * jnp.exp(-v) + self.floor
        shape = along * jnp.outer(z, z) + (a + self.isotropy) * jnp.eye(x.shape[0], dtype=x.dtype)
        return (gaussian_weight(square, width, near, far) * shape).astype(x.dtype)

    def potential(self, x):
        z = x - jnp.asarray(self.goal, x.dtype)
        width, near, far = self._weights(x.dtype)
        well = gaussian_well(matmul(z, z), width, jnp.asarray(self.sharpness, x.dtype), near, far)
        return (self.gain * (1 + self.isotropy) * well).astype(x.dtype)

    def _weights(self, dtype):
        """Width, value at the goal and value far away of w, as a Gaussian of the distance."""
        far = self.weight_far + (self.weight_near - self.weight_far) * self.floor
        return tuple(jnp.asarray(value, dtype) for value in (self.width, self.weight_near, far))
