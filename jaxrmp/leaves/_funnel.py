"""A way back to known postures: next to nothing near them, and outside a pull that outweighs tasks."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import ConfigurationError
from .._forms import DiagonalForm
from .._gds import GeometricDynamicalSystem
from .._linalg import matmul
from .._pytree import pytree, static
from .._ranges import NonNegative, Positive
from ._smooth_ratios import log_cosh


@pytree
class Funnel(GeometricDynamicalSystem):
    """Leads joints back to a tube round known postures; within it is nothing, or a faint pull to them.

    `d(q)`, the distance to the nearest of the postures, as a soft minimum:
    `d^2 = -softness log sum_k exp(-|q - q_k|^2 / softness)`. Share `s(d)`: a quintic step from 0 at `inner` to 1 at
    `outer`, both exact. `G = (w s + w_in) I`, `B = damping_rate G`, and `Phi / (speed damping_rate)` is w times the
    integral of s over d, plus `w_in taper log cosh(d / taper)`. With `w_in = 0` there is no force, no inertia and no
    damping inside the tube. A faint w_in settles what a task leaves open, such as where the elbow of a redundant arm
    is, all along the postures and across them alone. Outside it draws to the nearest posture at `speed`. A range of
    joints is a box, and so convex: from within, the way back never leaves it.

    **Arguments**: `postures` [S, n], rad or m, dense along a path of motion; `weight` w, the metric far outside;
    `within` w_in, everywhere; `speed`, rad/s or m/s; `damping_rate`, 1/s; `inner`, `outer`, `taper` and the square root
    of `softness`, units of q.
    **Raises** `ConfigurationError` for an inner radius, taper or softness that is not positive, an outer radius that is
    not larger than the inner, or a negative gain.

    >>> leaf = Funnel(jnp.zeros((1, 2)), inner=0.5, outer=1.0)
    >>> leaf(jnp.array([0.3, 0.0]), jnp.ones(2)).M.tolist(), leaf(jnp.array([2.0, 0.0]), jnp.zeros(2)).M[0, 0].tolist()
    ([[0.0, 0.0], [0.0, 0.0]], 1.0)

    Ours; docs/concepts.md measures what it does for a learned skill.
    """

    postures: jax.Array
    weight: NonNegative[jax.Array | float] = 1.0
    within: NonNegative[jax.Array | float] = 0.0
    speed: NonNegative[jax.Array | float] = 1.0
    damping_rate: NonNegative[jax.Array | float] = 40.0
    inner: Positive[jax.Array | float] = 0.5
    outer: Positive[jax.Array | float] = 0.8
    softness: Positive[jax.Array | float] = 0.02
    taper: Positive[jax.Array | float] = 0.15
    name: str = static(default="funnel")

    def __post_init__(self):
        radii = (self.inner, self.outer)
        if not any(isinstance(r, Tracer) for r in radii) and not np.all(
            np.asarray(self.inner) < np.asarray(self.outer)
        ):
            raise ConfigurationError(
                f"inner of Funnel is {self.inner!r} and outer {self.outer!r}: expected inner < outer."
            )

    def __call__(self, x, xd):
        return self.evaluate(x, xd).dense()

    def evaluate(self, x, xd):
        # G = g I: its curvature force is (g' xd) xd - 1/2 |xd|^2 grad g.
        d, slope = jax.value_and_grad(self.distance)(x)
        share, rise = jax.value_and_grad(self._share)(d)
        rise = self.weight * rise * slope
        pull = self.weight * share + self.within * jnp.tanh(d / self.taper)
        g = self.weight * share + self.within
        f = -self.damping_rate * (pull * self.speed * slope + g * xd)
        f = f - matmul(rise, xd) * xd + 0.5 * matmul(xd, xd) * rise
        return DiagonalForm(f.astype(x.dtype), jnp.broadcast_to(g, x.shape).astype(x.dtype))

    def metric(self, x, xd):
        g = self.weight * self._share(self.distance(x)) + self.within
        return (g * jnp.eye(x.shape[0])).astype(x.dtype)

    def potential(self, x):
        width = self.outer - self.inner
        d = self.distance(x)
        u = (d - self.inner) / width
        t = jnp.clip(u, 0, 1)
        integral = width * (t**4 * (2.5 + t * (t - 3)) + jnp.maximum(u - 1, 0))
        well = self.within * self.taper * log_cosh((d / self.taper) ** 2)
        return (self.speed * self.damping_rate * (self.weight * integral + well)).astype(x.dtype)

    def distance(self, x: jax.Array) -> jax.Array:
        """The distance d of `x` [n] from the nearest posture, a scalar in units of x; 0.01 at least."""
        offset = x - jnp.asarray(self.postures, x.dtype)
        nearest = -self.softness * jax.nn.logsumexp(-jnp.sum(offset * offset, -1) / self.softness)
        return jnp.sqrt(jnp.maximum(nearest, 1e-4)).astype(x.dtype)

    def gap(self, x):
        return jnp.maximum(self.distance(x) - self.inner, 0).astype(x.dtype)

    def _share(self, d):
        t = jnp.clip((d - self.inner) / (self.outer - self.inner), 0, 1)
        return t**3 * (10 + t * (6 * t - 15))
