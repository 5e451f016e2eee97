"""Joint limits, as a metric that grows as a joint moves towards its limit."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import RobotError, ShapeError
from .._gds import SeparableGDS
from .._pytree import pytree, set_field, static
from .._ranges import Finite, NonNegative, Positive
from ._barrier import ramp, wall, wall_inertia

_LEAST = 0.01  # of d, so that the metric stays finite at a limit and constant beyond it
_NEAREST = 50  # the barrier goes on as a straight line within this part of its reach


@pytree
class JointLimit(SeparableGDS):
    """Keeps every joint inside its range by making motion towards a near limit expensive.

    Per joint, with `s = (q - lower) / (upper - lower)`, `d = 4 s (1 - s)`, `a_u = 1 - exp(-max(qd, 0)^2 / (2 sigma^2))`
    and `a_l` likewise with `min(qd, 0)`:
    `b = s (a_u d + 1 - a_u) + (1 - s) (a_l d + 1 - a_l)`, `G = weight b^-2`. At rest or moving away, b is about 1 and
    the leaf is hardly felt; towards a limit b falls with d, which is held at or above 0.01: the
    metric has no pole, at a limit or beyond. The curvature terms are exact, and `B = damping_rate G`.
    The potential is the posture spring `1/2 weight stiffness |q - rest|^2`, the published force at zero velocity (at
    other velocities that has no potential), plus a barrier. The metric alone slows a joint down but lets a steady pull
    creep over its limit; the barrier `1/2 barrier (max(reach - x, 0) / x)^2`, x the distance to a limit, stops
    it. Within `reach / 50` of the limit and beyond it, the barrier goes on as a straight line, so that a state outside
    is pushed back in: at the limit it is `3651 barrier` high, which no motion of less energy crosses.
    Against the inertia of the other leaves, as small as it may be, such a wall would be too stiff for steps of a
    millisecond. So it brings its own: with `w = max(reach - x, 0) / x`, of which the barrier is `1/2 barrier w^2`, the
    metric `barrier (dw/dx)^2 w^2 / (1 + w^2) / frequency^2`, damped at `2 frequency`. In w, where w is not small, that
    is a critically damped spring of that frequency, however near the limit. `barrier=0` gives the published leaf.

    **Arguments**: `lower`, `upper` [n], rad or m, all finite; `rest` [n], the posture, default the middle; `weight`,
    the metric far from limits; `sigma`, the speed at which the metric takes effect, rad/s or m/s; `stiffness`, 1/s^2;
    `damping_rate`, 1/s; `barrier`, energy; `reach`, rad or m, where the barrier begins; `frequency`, 1/s, of motion
    against the barrier. All but the ranges may be numbers or [n].
    **Raises** `RobotError` if a range is empty or not finite, `ShapeError` if the ranges are not vectors alike,
    `ConfigurationError` for a weight, sigma, reach or frequency that is not positive, an infinite frequency, or a
    negative gain.

    >>> leaf = JointLimit(lower=-np.ones(1), upper=np.ones(1))
    >>> towards, away = (leaf(jnp.array([0.8]), jnp.array([speed])).M[0, 0] for speed in (1.0, -1.0))
    >>> bool(towards > 3 * away)
    True

    RMPflow (Cheng et al. 2018), appendix on experiments; the barrier is the potential of its collision leaf there.
    """

    lower: jax.Array
    upper: jax.Array
    rest: Finite[jax.Array | None] = None
    weight: Positive[jax.Array | float] = 0.01
    sigma: Positive[jax.Array | float] = 0.1
    stiffness: NonNegative[jax.Array | float] = 1e-5
    damping_rate: NonNegative[jax.Array | float] = 1e-5
    barrier: NonNegative[jax.Array | float] = 0.01
    reach: Positive[jax.Array | float] = 0.1
    frequency: Positive[Finite[jax.Array | float]] = 50.0
    name: str = static(default="joint_limit")

    def __post_init__(self):
        if not any(isinstance(value, Tracer) for value in vars(self).values()):
            lower, upper = np.asarray(self.lower), np.asarray(self.upper)
            if lower.ndim != 1 or lower.shape != upper.shape:
                raise ShapeError(f"lower and upper must both be [n], received shapes {lower.shape} and {upper.shape}.")
            set_field(self, "lower", self.lower if isinstance(self.lower, jax.Array) else lower)
            set_field(self, "upper", self.upper if isinstance(self.upper, jax.Array) else upper)
            bad = np.flatnonzero(~(np.isfinite(lower) & np.isfinite(upper) & (lower < upper)))
            if bad.size:
                raise RobotError(
                    f"joint ranges must be finite with lower < upper; joints {bad.tolist()} have lower "
                    f"{lower[bad].tolist()} and upper {upper[bad].tolist()}. For a robot's joints, "
                    "policies.joint_limits(robot) selects those that have limits; otherwise "
                    "pullback(Selection(...), JointLimit(...))."
                )
        if self.rest is None:
            set_field(self, "rest", (self.lower + self.upper) / 2)

    def gap(self, x):
        return jnp.minimum(*self._distances(x)).min().astype(x.dtype)

    def metric(self, x, xd):
        s = jnp.clip((x - self.lower) / (self.upper - self.lower), 0, 1)
        d = jnp.maximum(4 * s * (1 - s), _LEAST)
        towards_upper = -jnp.expm1(-(jnp.maximum(xd, 0) ** 2) / (2 * self.sigma**2))
        towards_lower = -jnp.expm1(-(jnp.minimum(xd, 0) ** 2) / (2 * self.sigma**2))
        b = s * (towards_upper * d + 1 - towards_upper) + (1 - s) * (towards_lower * d + 1 - towards_lower)
        return (self.weight / (b * b) + self._wall_inertia(x)).astype(x.dtype)

    def potential(self, x):
        spring = 0.5 * self.weight * self.stiffness * (x - self.rest) ** 2
        walls = sum(wall(*self._ramp(d), jnp.minimum(d - self.reach / _NEAREST, 0)) for d in self._distances(x))
        return (spring + self.barrier * walls).astype(x.dtype)

    def damping(self, x, xd):
        own = 2 * self.frequency * self._wall_inertia(x)
        return (self.damping_rate * self.metric(x, xd) + own).astype(x.dtype)

    def _wall_inertia(self, x):
        inertia = sum(wall_inertia(*self._ramp(d)) for d in self._distances(x))
        return self.barrier * inertia / self.frequency**2

    def _distances(self, x):
        return x - self.lower, self.upper - x

    def _ramp(self, distance):
        return ramp(jnp.maximum(distance, self.reach / _NEAREST), self.reach)
