"""The brake on joints that come near their highest speed."""

import jax
import jax.numpy as jnp

from ..._pytree import pytree, static
from ..._ranges import NonNegative, Positive
from ..._tree import SeparableLeaf
from ._elementwise import elementwise

_POLE = 1e-3  # of 1 - s^2 / v_r^2: how near the metric goes to its pole


@pytree
class JointVelocityCap(SeparableLeaf):
    """Brakes every joint whose speed comes near `max_velocity`, with a metric that grows without bound towards it.

    Per joint, with `s = |qd| - (v_max - v_r)`: `a = -k_d sign(qd) s`, `m = 0` for s < 0, else `mu / (1 - s^2 / v_r^2)`.
    At the pole s = v_r and beyond it the metric stays at 1,000 mu.

    **Arguments**: `max_velocity` v_max, rad/s or m/s, a number or [n]; `velocity_damping_region` v_r, the same;
    `damping_gain` k_d, 1/s; `metric_weight` mu.
    **Raises** `ConfigurationError` for a negative number, or a region that is zero.

    >>> form = JointVelocityCap(max_velocity=1.7)(jnp.zeros(2), jnp.array([1.0, 1.6]))
    >>> bool(form.f[0] == 0), bool(form.f[1] < 0)
    (True, True)

    NVIDIA, Lula RMPflow, `joint_velocity_cap_rmp`.
    """

    max_velocity: NonNegative[jax.Array | float] = 1.7
    velocity_damping_region: Positive[jax.Array | float] = 0.35
    damping_gain: NonNegative[jax.Array | float] = 10.0
    metric_weight: NonNegative[jax.Array | float] = 2000.0
    name: str = static(default="joint_velocity_cap")
    certified = False

    def evaluate(self, x, xd):
        s = jnp.abs(xd) - (self.max_velocity - self.velocity_damping_region)
        below_pole = jnp.maximum(1 - (s / self.velocity_damping_region) ** 2, _POLE)
        m = jnp.where(s < 0, 0, self.metric_weight / below_pole)
        return elementwise(-self.damping_gain * jnp.sign(xd) * s, m, x)
