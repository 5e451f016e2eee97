"""The turn of a frame's axis towards a direction."""

import jax
import jax.numpy as jnp

from ..._forms import DiagonalForm
from ..._linalg import length, matmul
from ..._pytree import pytree, static
from ..._ranges import Finite, NonNegative, Positive
from ..._tree import SeparableLeaf
from ._position_target import proximity_boost


@pytree
class AxisTarget(SeparableLeaf):
    """Turns a unit vector of a frame to `target`; three of them, on three axes, hold an orientation.

    `a = k_p (n_0 - n) - k_d nd`, `M = [beta b + 1 - beta] mu I`. With a `position_target` x_0,
    `beta = exp(-r^2 / (2 s_b^2))` of the frame's distance r to it, so that orientation counts most at the end; without
    one `M = mu I`.

    Its space is the unit vector n [3], or with a `position_target` the six numbers (n, x), x the frame's position,
    on which it does not act.

    **Arguments**: `target` n_0 [3], a unit vector; `position_target` x_0 [3], m, or None; `accel_p_gain` k_p, 1/s^2;
    `accel_d_gain` k_d, 1/s; `metric_scalar` mu; `proximity_metric_boost_scalar` b;
    `proximity_metric_boost_length_scale` s_b, m.
    **Raises** `ConfigurationError` for a negative number, or a length that is zero.

    >>> AxisTarget(target=jnp.array([0.0, 0.0, 1.0]))(jnp.array([1.0, 0.0, 0.0]), jnp.zeros(3)).f.tolist()
    [-2100.0, 0.0, 2100.0]

    NVIDIA, Lula RMPflow, `axis_target_rmp`.
    """

    target: Finite[jax.Array]
    position_target: Finite[jax.Array | None] = None
    accel_p_gain: NonNegative[jax.Array | float] = 210.0
    accel_d_gain: NonNegative[jax.Array | float] = 60.0
    metric_scalar: NonNegative[jax.Array | float] = 10.0
    proximity_metric_boost_scalar: NonNegative[jax.Array | float] = 3000.0
    proximity_metric_boost_length_scale: Positive[jax.Array | float] = 0.02
    name: str = static(default="axis_target")
    has_goal = True
    certified = False

    def gap(self, x: jax.Array) -> jax.Array:
        """The distance left between the two unit vectors at `x` [6], for the inspector."""
        return length(jnp.asarray(self.target, x.dtype) - x[:3])

    def evaluate(self, x, xd):
        a = self.accel_p_gain * (jnp.asarray(self.target, x.dtype) - x[:3]) - self.accel_d_gain * xd[:3]
        m = jnp.full((3,), self.metric_scalar, x.dtype)
        if self.position_target is not None:
            offset = jnp.asarray(self.position_target, x.dtype) - x[3:]
            m *= proximity_boost(
                matmul(offset, offset), self.proximity_metric_boost_scalar, self.proximity_metric_boost_length_scale
            )
            a, m = jnp.pad(a, (0, 3)), jnp.pad(m, (0, 3))
        return DiagonalForm((m * a).astype(x.dtype), m.astype(x.dtype))
