"""Avoidance of obstacles, as a metric that grows on the way towards them."""

from typing import Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import ConfigurationError, UnknownNameError
from .._gds import SeparableGDS
from .._pytree import pytree, static
from .._ranges import NonNegative, Positive
from ._barrier import ramp, wall, wall_inertia

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

    A high barrier in front of little inertia is too stiff for an integrator. With a finite `frequency` it brings its
    own: the metric `barrier (dw/dd)^2 w^2 / (1 + w^2) / frequency^2` more, damped at `2 frequency`, so that, seen from
    w and where w is not small, it is a critically damped spring of that frequency, however near.

    **Arguments**: `epsilon`, the share of w that is metric at rest; `barrier` (alpha of the paper), energy;
    `damping_rate`, 1/s; `reach`, units of d, and `sigma`, the speed at which the metric takes effect, units of d per
    second, both of the compact form; `floor`, units of d, by default `reach / 50` (compact) or 0.05 (power). Numbers or
    [m]. `frequency`, 1/s, times the integration step well below one, infinite for none. `form` is structure.
    **Raises** `UnknownNameError` for another form; `ConfigurationError` for a reach, sigma, floor or frequency that is
    not positive, a floor that is not below the reach (compact), or another negative parameter.

    The defaults keep an arm of a metre off at steps of 1 ms. Published are `epsilon` 0.2, `barrier` 1e-5 and an
    infinite `frequency`, without damping, which let it touch.

    >>> leaf = CollisionAvoidance()
    >>> near, far = leaf(jnp.array([0.01, 0.1]), jnp.zeros(2)).f
    >>> bool(near > 0), bool(far == 0)
    (True, True)

    RMPflow (Cheng et al. 2018), collision avoidance (power), and as in its experiments (compact). The continuation
    below the floor and the barrier's inertia are this library's.
    """

    epsilon: NonNegative[jax.Array | float] = 0.1
    barrier: NonNegative[jax.Array | float] = 0.01
    damping_rate: NonNegative[jax.Array | float] = 2.0
    reach: Positive[jax.Array | float] = 0.06
    sigma: Positive[jax.Array | float] = 0.1
    floor: Positive[jax.Array | float | None] = None
    frequency: Positive[jax.Array | float] = 100.0
    form: Form = static(default="compact")
    name: str = static(default="collision_avoidance")

    def __post_init__(self):
        UnknownNameError.check("form of collision avoidance", self.form, get_args(Form))
        limits = (self.floor, self.reach)
        known = self.floor is not None and not any(isinstance(value, Tracer) for value in limits)
        if self.form == "compact" and known and not np.all(np.asarray(self.floor) < np.asarray(self.reach)):
            raise ConfigurationError(f"floor is {self.floor} and reach {self.reach}: expected floor < reach.")

    def gap(self, x: jax.Array) -> jax.Array:
        """The smallest of the distances `x` [m], for the inspector."""
        return jnp.min(x)

    def metric(self, x, xd):
        w, slope = self._weight_and_slope(x)
        v = jnp.minimum(xd, 0)
        u = v * v if self.form == "power" else -jnp.expm1(-(v * v) / (2 * self.sigma**2))
        period = 1 / self.frequency
        own = self.barrier * wall_inertia(w, slope) * period * period
        return (w * (self.epsilon + u) + own).astype(x.dtype)

    def potential(self, x):
        walls = wall(*self._weight_and_slope(x), jnp.minimum(x - self._floor(), 0))
        return (self.barrier * walls).astype(x.dtype)

    def damping(self, x, xd):
        own = 2 * self.barrier * wall_inertia(*self._weight_and_slope(x)) / self.frequency
        return (self.damping_rate * self.metric(x, xd) + own).astype(x.dtype)

    def _floor(self):
        if self.floor is not None:
            return self.floor
        return 0.05 if self.form == "power" else self.reach / 50

    def _weight_and_slope(self, x):
        """`w` and `dw/dd`, at the distance or at the floor."""
        d = jnp.maximum(x, self._floor())
        return (d**-4, -4 * d**-5) if self.form == "power" else ramp(d, self.reach)
