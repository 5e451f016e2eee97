"""The attractor behind a flow of turns, which ends before the half turns, where coordinates of turns do."""

import jax
import jax.numpy as jnp

from .._gds import GeometricDynamicalSystem
from .._linalg import matmul
from .._pytree import pytree, static
from .._ranges import NonNegative, Positive
from ..leaves._smooth_ratios import log_cosh
from ._hand_maps import step

_FADED = 0.8  # of b: from there on, 164 degrees, nothing of y counts


@pytree
class TurnAttractor(GeometricDynamicalSystem):
    """Pulls y to zero at a cruise speed, and fades into a slope along the shortest rotation where y ends.

    Its space is `(y [m], b)`, y the coordinates of a turn behind a flow, and b how far it is beyond where they are
    good, from 0 to 1 at the half turns (`BeyondTurn`). With `s(b)` from 1 at 0 to 0 at 0.8, smooth:
    `Phi = w speed damping_rate (s taper log cosh(|y| / taper) + (1 - s) top + length b)`, `G = diag(w s, w length^2)`,
    `B = damping_rate G`. Where b is 0 it is `leaves.CruisingAttractor`. If `top` is no less than the well of y is where
    it fades, Phi rises with b, whatever the flow is, and is highest at the half turns: no smooth potential of turns can
    do without a place of rest there, and any disturbance frees a frame from it.

    **Arguments**: `top`, m; `length`, m, what b counts for; the rest as `CruisingAttractor` has it.
    **Raises** `ConfigurationError` for a negative parameter, or a taper that is zero.

    Ours; on the slope see `leaves.OrientationAttractor`.
    """

    top: NonNegative[jax.Array | float]
    weight: NonNegative[jax.Array | float] = 1.0
    speed: NonNegative[jax.Array | float] = 0.2
    damping_rate: NonNegative[jax.Array | float] = 40.0
    taper: Positive[jax.Array | float] = 0.03
    length: Positive[jax.Array | float] = 0.15
    name: str = static(default="attractor")
    has_goal = True

    def metric(self, x, xd):
        w, y = jnp.asarray(self.weight, x.dtype), jnp.ones_like(x[:-1])
        return jnp.diag(jnp.append(w * _share(x) * y, w * jnp.asarray(self.length, x.dtype) ** 2))

    def potential(self, x):
        y, s = x[:-1], _share(x)
        well = self.taper * log_cosh(matmul(y, y) / jnp.asarray(self.taper, x.dtype) ** 2)
        rise = s * well + (1 - s) * self.top + self.length * x[-1]
        return (self.weight * self.speed * self.damping_rate * rise).astype(x.dtype)


def _share(x: jax.Array) -> jax.Array:
    """How much of y counts."""
    return 1 - step(jnp.clip(x[-1] / _FADED, 0, 1))
