"""A way back to known postures: next to nothing near them, and outside a pull that outweighs tasks."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import ConfigurationError
from .._forms import DiagonalForm
from .._gds import GeometricDynamicalSystem
from .._linalg import matmul
from .._pytree import pytree, set_field, static
from .._ranges import Finite, NonNegative, Positive
from ._smooth_ratios import log_cosh

_ROUND = 1e-3  # within which the cone of a posture's distance is rounded off


@pytree
class Funnel(GeometricDynamicalSystem):
    """Leads joints back to a tube round known postures, and on along them; within it is nothing, or a faint pull.

    `d(q)`, the distance to the nearest of the postures, is a soft minimum of `|q - q_k|`, and `l(q)`, how much is left
    from where it leads, the soft minimum of `|q - q_k| + left_k` less d. Share `s(d)`: a quintic step from 0 at `inner`
    to 1 at `outer`, both exact; `b(d)`, the same from `onset`. `G = (w (s + l b') + w_in) I`, `B = damping_rate G`, and
    `Phi / (speed damping_rate)` is w times the integral of s over d, plus `w b l`, plus `w_in taper log cosh(d /
    taper)`. With `w_in = 0` there is no force, no inertia and no damping nearer than both `inner` and `onset`. Beyond
    inner it draws to the nearest posture at `speed`, and beyond onset, with `left`, the length of the way from each
    posture on, along it as well. An onset well before inner matters: what pulls out of the tube, such as a task whose
    way bends, rests where a wall alone holds it, and is led on where the way's pull has grown before. A range of
    joints is a box, and so convex: from within, the way back never leaves it. A faint w_in settles what a task leaves
    open, such as where the elbow of a redundant arm is.

    **Arguments**: `postures` [S, n], rad or m, dense along a path of motion; `left` [S], units of q; `weight` w, the
    metric far outside; `within` w_in, everywhere; `speed`, rad/s or m/s; `damping_rate`, 1/s; `inner`, `outer`,
    `onset` (by default inner), `taper` and `softness`, units of q.
    **Raises** `ConfigurationError` for postures that are not finite, an inner radius, taper or softness that is not
    positive, an outer radius that is not larger than inner and onset, or a negative gain or length.

    >>> leaf = Funnel(jnp.zeros((1, 2)), inner=0.5, outer=1.0)
    >>> leaf(jnp.array([0.3, 0.0]), jnp.ones(2)).M.tolist(), leaf(jnp.array([2.0, 0.0]), jnp.zeros(2)).M[0, 0].tolist()
    ([[0.0, 0.0], [0.0, 0.0]], 1.0)

    Ours; docs/concepts.md measures what it does for a learned skill.
    """

    postures: Finite[jax.Array]
    left: NonNegative[jax.Array | float] = 0.0
    weight: NonNegative[jax.Array | float] = 1.0
    within: NonNegative[jax.Array | float] = 0.0
    speed: NonNegative[jax.Array | float] = 1.0
    damping_rate: NonNegative[jax.Array | float] = 40.0
    inner: Positive[jax.Array | float] = 0.5
    outer: Positive[jax.Array | float] = 0.8
    onset: NonNegative[jax.Array | float | None] = None
    softness: Positive[jax.Array | float] = 0.05
    taper: Positive[jax.Array | float] = 0.15
    name: str = static(default="funnel")

    def __post_init__(self):
        if self.onset is None:
            set_field(self, "onset", self.inner)
        for name, radius in (("inner", self.inner), ("onset", self.onset)):
            if any(isinstance(r, Tracer) for r in (radius, self.outer)):
                continue
            if not np.all(np.asarray(radius) < np.asarray(self.outer)):
                raise ConfigurationError(
                    f"{name} of Funnel is {radius!r} and outer {self.outer!r}: expected {name} < outer."
                )

    def __call__(self, x, xd):
        return self.evaluate(x, xd).dense()

    def evaluate(self, x, xd):
        # G = g I: its curvature force is (g' xd) xd - 1/2 |xd|^2 grad g.
        (d, left), (toward, along) = self._place(x)
        wall, wall_slope, _ = _share(d, self.inner, self.outer)
        share, slope, bend = _share(d, self.onset, self.outer)
        outside = self.weight * (wall + left * slope)
        well = self.within * jnp.tanh(d / self.taper)
        pull = (outside + well) * toward + self.weight * share * along
        g = outside + self.within
        rise = self.weight * ((wall_slope + left * bend) * toward + slope * along)
        f = -self.damping_rate * (self.speed * pull + g * xd)
        f = f - matmul(rise, xd) * xd + 0.5 * matmul(xd, xd) * rise
        return DiagonalForm(f.astype(x.dtype), jnp.broadcast_to(g, x.shape).astype(x.dtype))

    def metric(self, x, xd):
        (d, left), _ = self._place(x)
        wall, _, _ = _share(d, self.inner, self.outer)
        _, slope, _ = _share(d, self.onset, self.outer)
        g = self.weight * (wall + left * slope) + self.within
        return (g * jnp.eye(x.shape[0])).astype(x.dtype)

    def potential(self, x):
        width = self.outer - self.inner
        (d, left), _ = self._place(x)
        u = (d - self.inner) / width
        t = jnp.clip(u, 0, 1)
        integral = width * (t**4 * (2.5 + t * (t - 3)) + jnp.maximum(u - 1, 0))
        well = self.within * self.taper * log_cosh((d / self.taper) ** 2)
        outside = integral + _share(d, self.onset, self.outer)[0] * left
        return (self.speed * self.damping_rate * (self.weight * outside + well)).astype(x.dtype)

    def distance(self, x: jax.Array) -> jax.Array:
        """The distance d of `x` [n] from the nearest posture, a scalar in units of x, not negative."""
        (d, _), _ = self._place(x)
        return d

    def gap(self, x):
        return jnp.maximum(self.distance(x) - self.inner, 0).astype(x.dtype)

    def _place(self, x):
        """d and l at a place, and the slopes [n] of both."""
        offset = x - jnp.asarray(self.postures, x.dtype)
        far = jnp.sqrt(jnp.sum(offset * offset, -1) + _ROUND**2)
        nearest, toward = self._soft_minimum(far - _ROUND, offset / far[:, None])
        onward, along = self._soft_minimum(far - _ROUND + jnp.asarray(self.left, x.dtype), offset / far[:, None])
        inside = nearest <= 0  # of the soft minimum of many that are near
        d = jnp.where(inside, 0, nearest).astype(x.dtype)
        return (d, onward - nearest), (jnp.where(inside, 0, toward), along - toward)

    def _soft_minimum(self, values, slopes):
        """`-softness log sum_k exp(-value_k / softness)`, and its slope [n], by those of the values [S, n]."""
        least = values.min()
        shares = jnp.exp((least - values) / self.softness)
        total = jnp.sum(shares)
        return least - self.softness * jnp.log(total), matmul(shares / total, slopes)


def _share(d, inner, outer):
    """From 0 at `inner` to 1 at `outer`, a quintic of the distance d: with its slope, and the slope of that."""
    width = outer - inner
    t = jnp.clip((d - inner) / width, 0, 1)
    share = t**3 * (10 + t * (6 * t - 15))
    return share, 30 * (t * (1 - t)) ** 2 / width, 60 * t * (1 - t) * (1 - 2 * t) / width**2
