"""The pull of a frame towards a point."""

import jax
import jax.numpy as jnp

from ..._forms import CanonicalForm, NaturalForm, natural
from ..._linalg import length, matmul
from ..._pytree import pytree, static
from ..._ranges import Finite, NonNegative, Positive
from ..._tree import Leaf
from .._smooth_ratios import decay_ratio


@pytree
class PositionTarget(Leaf):
    """Pulls a point in space to `target`: far away along the line to it only, near it in all directions.

    With `delta = x_0 - x`, `r = |delta|`: `a = k_p delta / (r + eps) - k_d xd` and
    `M = [beta b + 1 - beta] [alpha mu_near I + (1 - alpha) mu_far delta delta^T / r^2]`, with
    `alpha = (1 - alpha_min) exp(-r^2 / (2 s_a^2)) + alpha_min` and `beta = exp(-r^2 / (2 s_b^2))`. At the target its
    derivatives exist.

    **Arguments**: `target` x_0 [3], m; `accel_p_gain` k_p, m/s^2; `accel_d_gain` k_d, 1/s; `accel_norm_eps` eps, m;
    `metric_alpha_length_scale` s_a, m; `min_metric_alpha` alpha_min, 0 to 1; `max_metric_scalar` mu_near;
    `min_metric_scalar` mu_far; `proximity_metric_boost_scalar` b; `proximity_metric_boost_length_scale` s_b, m.
    **Raises** `ConfigurationError` for a negative number, or a length that is zero.

    >>> PositionTarget(target=jnp.ones(3))(jnp.ones(3), jnp.zeros(3)).M[0].tolist()
    [200000.0, 0.0, 0.0]

    NVIDIA, Lula RMPflow, `target_rmp`.
    """

    target: Finite[jax.Array]
    accel_p_gain: NonNegative[jax.Array | float] = 50.0
    accel_d_gain: NonNegative[jax.Array | float] = 75.0
    accel_norm_eps: Positive[jax.Array | float] = 0.075
    metric_alpha_length_scale: Positive[jax.Array | float] = 0.05
    min_metric_alpha: NonNegative[jax.Array | float] = 0.03
    max_metric_scalar: NonNegative[jax.Array | float] = 10000.0
    min_metric_scalar: NonNegative[jax.Array | float] = 5000.0
    proximity_metric_boost_scalar: NonNegative[jax.Array | float] = 20.0
    proximity_metric_boost_length_scale: Positive[jax.Array | float] = 0.02
    name: str = static(default="position_target")
    has_goal = True
    certified = False
    _place = "target"

    def __call__(self, x, xd):
        delta = jnp.asarray(self.target, x.dtype) - x
        square = matmul(delta, delta)
        a = self.accel_p_gain * delta / (length(delta) + self.accel_norm_eps) - self.accel_d_gain * xd
        near = square / (2 * self.metric_alpha_length_scale**2)
        alpha = (1 - self.min_metric_alpha) * jnp.exp(-near) + self.min_metric_alpha
        # (1 - alpha) / r^2 is smooth at the target, where it would be 0 / 0.
        stretch = (1 - self.min_metric_alpha) * decay_ratio(near) / (2 * self.metric_alpha_length_scale**2)
        eye = jnp.eye(x.shape[0], dtype=x.dtype)
        M = alpha * self.max_metric_scalar * eye + stretch * self.min_metric_scalar * jnp.outer(delta, delta)
        boost = proximity_boost(square, self.proximity_metric_boost_scalar, self.proximity_metric_boost_length_scale)
        form = natural(CanonicalForm(a, boost * M))
        return NaturalForm(form.f.astype(x.dtype), form.M.astype(x.dtype))


def proximity_boost(square: jax.Array, boost: jax.Array | float, length_scale: jax.Array | float) -> jax.Array:
    """`beta b + 1 - beta` with `beta = exp(-r^2 / (2 s^2))`, for `square = r^2`: 1 far away, b at the target."""
    beta = jnp.exp(-square / (2 * length_scale**2))
    return beta * boost + 1 - beta
