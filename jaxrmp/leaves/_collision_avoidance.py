"""Avoidance of obstacles, as a metric that grows on the way towards them."""

from typing import Literal, get_args

import jax
import jax.numpy as jnp

from .._errors import UnknownNameError
from .._gds import SeparableGDS
from .._pytree import pytree, static
from ._parameters import require

Form = Literal["compact", "power"]


@pytree
class CollisionAvoidance(SeparableGDS):
    """Keeps every distance of its space positive: motion that shortens it becomes expensive, and a barrier pushes back.

    Per distance d: `G = w(d) u(dd)`, `Phi = 1/2 barrier w^2`, `B = damping_rate G`, with exact curvature terms, in one
    of the two published forms, with `v = min(dd, 0)`:

    - `"compact"`: `w = max(reach - d, 0) / d`, `u = epsilon + 1 - exp(-v^2 / (2 sigma^2))`: felt within `reach`
      only. For distances in metres.
    - `"power"`: `w = d^-4`, `u = epsilon + v^2`: felt everywhere. Made for `d = |x - center| / radius - 1`, a number.

    Distances below `floor`, contact (d <= 0) included, count as `floor` in w, and the potential goes on as its tangent:
    the push out stays finite and constant, and the certificate holds there too. At the floor the potential is
    `1/2 barrier w(floor)^2` high, which no motion of less energy crosses. At `d = reach`, w has a kink.

    **Arguments**: `epsilon`, the share of w that is metric at rest; `barrier` (alpha of the paper), energy;
    `damping_rate`, 1/s; `reach`, units of d, and `sigma`, the speed at which the metric takes effect, units of d per
    second, both of the compact form; `floor`, units of d, by default `reach / 50` (compact) or 0.05 (power). Numbers or
    [m]. `form` is structure.
    **Raises** `UnknownNameError` for another form; `ConfigurationError` for a reach, sigma or floor that is not
    positive, or another negative parameter.

    RMPflow (Cheng et al. 2018), collision avoidance (power), and as in its experiments (compact). The continuation
    below the floor is this library's.
    """

    epsilon: jax.Array | float = 0.2
    barrier: jax.Array | float = 1e-5
    damping_rate: jax.Array | float = 0.0
    reach: jax.Array | float = 0.07
    sigma: jax.Array | float = 0.5
    floor: jax.Array | float | None = None
    form: Form = static(default="compact")
    name: str = static(default="collision_avoidance")

    def __post_init__(self):
        if self.form not in get_args(Form):
            raise UnknownNameError("form of collision avoidance", self.form, get_args(Form))
        require(self, positive=("reach", "sigma", "floor"), non_negative=("epsilon", "barrier", "damping_rate"))

    def gap(self, x: jax.Array) -> jax.Array:
        """The smallest distance, for the inspector."""
        return jnp.min(x)

    def metric(self, x, xd):
        w, _ = self._weight_and_slope(x)
        v = jnp.minimum(xd, 0)
        u = v * v if self.form == "power" else -jnp.expm1(-(v * v) / (2 * self.sigma**2))
        return (w * (self.epsilon + u)).astype(x.dtype)

    def potential(self, x):
        w, slope = self._weight_and_slope(x)
        beyond = jnp.minimum(x - self._floor(), 0)
        return (self.barrier * (0.5 * w * w + w * slope * beyond)).astype(x.dtype)

    def damping(self, x, xd):
        return (self.damping_rate * self.metric(x, xd)).astype(x.dtype)

    def _floor(self):
        if self.floor is not None:
            return self.floor
        return 0.05 if self.form == "power" else self.reach / 50

    def _weight_and_slope(self, x):
        """`w` and `dw/dd`, at the distance or at the floor."""
        d = jnp.maximum(x, self._floor())
        if self.form == "power":
            return d**-4, -4 * d**-5
        w = jnp.maximum(self.reach - d, 0) / d
        return w, jnp.where(d < self.reach, -self.reach / (d * d), 0)
