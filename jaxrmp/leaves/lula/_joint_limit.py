"""The push of every joint away from the ends of its range."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from ..._errors import RobotError
from ..._forms import DiagonalForm
from ..._pytree import pytree, static
from ..._ranges import NonNegative, Positive
from ..._tree import SeparableLeaf
from ._elementwise import closed_gate


@pytree
class JointLimit(SeparableLeaf):
    """Pushes every joint away from both ends of its range, and brakes it near them.

    A scalar policy an end, on the distance to that end as a share of the range, `x = (q - lower) / (upper - lower)` or
    its mirror: `a = k_p / (x^2 / l_p^2 + eps_p) - k_d xd`, `m = sig(xd / v_m) mu / (x / l_m + eps_m)` with
    `sig(z) = 1 / (1 + exp(z))`; both ends pulled back to q and added. Beyond an end x counts as zero, where push and
    metric are at their largest. A joint without a finite range is left alone.

    **Arguments**: `lower`, `upper` [n], rad or m, already shrunk by any buffers; `metric_scalar` mu;
    `metric_length_scale` l_m; `metric_exploder_eps` eps_m; `metric_velocity_gate_length_scale` v_m, 1/s;
    `accel_damper_gain` k_d, 1/s; `accel_potential_gain` k_p, 1/s^2; `accel_potential_exploder_length_scale` l_p;
    `accel_potential_exploder_eps` eps_p.
    **Raises** `RobotError` if a range is empty, `ConfigurationError` for a negative number, or a
    length or eps that is zero.

    >>> form = JointLimit(lower=-jnp.ones(2), upper=jnp.ones(2))(jnp.array([0.0, 0.9]), jnp.zeros(2))
    >>> float(form.f[0]), bool(form.f[1] < 0)
    (0.0, True)

    NVIDIA, Lula RMPflow, `joint_limit_rmp`.
    """

    lower: jax.Array
    upper: jax.Array
    metric_scalar: NonNegative[jax.Array | float] = 1000.0
    metric_length_scale: Positive[jax.Array | float] = 0.01
    metric_exploder_eps: Positive[jax.Array | float] = 1e-3
    metric_velocity_gate_length_scale: Positive[jax.Array | float] = 0.01
    accel_damper_gain: NonNegative[jax.Array | float] = 200.0
    accel_potential_gain: NonNegative[jax.Array | float] = 1.0
    accel_potential_exploder_length_scale: Positive[jax.Array | float] = 0.1
    accel_potential_exploder_eps: Positive[jax.Array | float] = 1e-2
    name: str = static(default="joint_limit")
    certified = False

    def __post_init__(self):
        if not any(isinstance(v, Tracer) for v in (self.lower, self.upper)):
            lower, upper = np.asarray(self.lower), np.asarray(self.upper)
            bad = np.flatnonzero(~(lower < upper))
            if bad.size:
                raise RobotError(
                    f"joint ranges must have lower < upper, buffers taken off; joints {bad.tolist()} have lower "
                    f"{lower[bad].tolist()} and upper {upper[bad].tolist()}."
                )

    def gap(self, x):
        return jnp.minimum(x - jnp.asarray(self.lower, x.dtype), jnp.asarray(self.upper, x.dtype) - x).min()

    def evaluate(self, x, xd):
        lower, upper = jnp.asarray(self.lower, x.dtype), jnp.asarray(self.upper, x.dtype)
        is_limited = jnp.isfinite(lower) & jnp.isfinite(upper)
        span = jnp.where(is_limited, upper - lower, 1)
        a_low, m_low = self._end(jnp.where(is_limited, x - lower, 1) / span, xd / span)
        a_up, m_up = self._end(jnp.where(is_limited, upper - x, 1) / span, -xd / span)
        f = jnp.where(is_limited, (m_low * a_low - m_up * a_up) / span, 0)
        m = jnp.where(is_limited, (m_low + m_up) / (span * span), 0)
        return DiagonalForm(f.astype(x.dtype), m.astype(x.dtype))

    def _end(self, x, xd):
        x = jnp.maximum(x, 0)
        away = self.accel_potential_gain / (
            (x / self.accel_potential_exploder_length_scale) ** 2 + self.accel_potential_exploder_eps
        )
        gate = closed_gate(xd / self.metric_velocity_gate_length_scale)
        m = gate * self.metric_scalar / (x / self.metric_length_scale + self.metric_exploder_eps)
        return away - self.accel_damper_gain * xd, m
