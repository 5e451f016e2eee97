"""A way back to known postures: nothing near them, and outside a pull to the nearest that outweighs tasks."""

import jax
import jax.numpy as jnp

from .._forms import DiagonalForm
from .._gds import GeometricDynamicalSystem
from .._linalg import matmul
from .._pytree import pytree, static
from .._ranges import NonNegative, Positive


@pytree
class Funnel(GeometricDynamicalSystem):
    """Leads joints back to a tube round known postures, and is nothing at all within it.

    `d(q)`, the distance to the nearest of the postures, as a soft minimum:
    `d^2 = -softness log sum_k exp(-|q - q_k|^2 / softness)`. Share `s(d)`: a quintic step from 0 at `inner` to 1 at
    `outer`, both exact. `G = w s I`, `Phi = w speed damping_rate` times the integral of s over d, `B = damping_rate G`.
    Inside the tube there is no force, no inertia and no damping, so that what was learned there stays as it is. Outside
    it draws to the nearest posture at `speed`. A range of joints is a box, and so convex: from within, the way back
    never leaves it.

    **Arguments**: `postures` [S, n], rad or m, dense along a path of motion; `weight` w, the metric far outside;
    `speed`, rad/s or m/s; `damping_rate`, 1/s; `inner`, `outer` and the square root of `softness`, units of q.
    **Raises** `ConfigurationError` for an inner radius or softness that is not positive, or a negative gain.

    >>> leaf = Funnel(jnp.zeros((1, 2)), inner=0.5, outer=1.0)
    >>> leaf(jnp.array([0.3, 0.0]), jnp.ones(2)).M.tolist(), leaf(jnp.array([2.0, 0.0]), jnp.zeros(2)).M[0, 0].tolist()
    ([[0.0, 0.0], [0.0, 0.0]], 1.0)

    Ours; docs/concepts.md measures what it does for a learned skill.
    """

    postures: jax.Array
    weight: NonNegative[jax.Array | float] = 1.0
    speed: NonNegative[jax.Array | float] = 1.0
    damping_rate: NonNegative[jax.Array | float] = 40.0
    inner: Positive[jax.Array | float] = 0.5
    outer: Positive[jax.Array | float] = 0.8
    softness: Positive[jax.Array | float] = 0.02
    name: str = static(default="funnel")

    def __call__(self, x, xd):
        return self.evaluate(x, xd).dense()

    def evaluate(self, x, xd):
        # G = g I: its curvature force is (g' xd) xd - 1/2 |xd|^2 grad g.
        d, slope = jax.value_and_grad(self.distance)(x)
        share, rise = jax.value_and_grad(self._share)(d)
        rise = self.weight * rise * slope
        g = self.weight * share
        f = -self.damping_rate * g * (self.speed * slope + xd) - matmul(rise, xd) * xd + 0.5 * matmul(xd, xd) * rise
        return DiagonalForm(f.astype(x.dtype), jnp.broadcast_to(g, x.shape).astype(x.dtype))

    def metric(self, x, xd):
        return (self.weight * self._share(self.distance(x)) * jnp.eye(x.shape[0])).astype(x.dtype)

    def potential(self, x):
        width = self.outer - self.inner
        u = (self.distance(x) - self.inner) / width
        t = jnp.clip(u, 0, 1)
        integral = width * (t**4 * (2.5 + t * (t - 3)) + jnp.maximum(u - 1, 0))
        return (self.weight * self.speed * self.damping_rate * integral).astype(x.dtype)

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
