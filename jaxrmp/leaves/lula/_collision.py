"""The push away from obstacles, and from the robot's own base."""

import jax
import jax.numpy as jnp

from ..._pytree import pytree, static
from ..._ranges import NonNegative, Positive
from ..._tree import SeparableLeaf
from ._elementwise import closed_gate, elementwise


@pytree
class Collision(SeparableLeaf):
    """Pushes apart what is near and brakes what comes nearer; a scalar policy a distance.

    With `x = max(d, 0)`: `a = k_p exp(-x / l_p) - k_d sig(xd / v_d) xd / (x / l_d + eps_d)` and
    `m = sig(xd / v_d) (1 - x / r)^2 mu / (x / l_m + eps_m)` for x <= r, else 0; `sig(z) = 1 / (1 + exp(z))`. Push and
    metric are at their largest in contact and inside.

    Its space is distances [P].

    **Arguments**: `damping_gain` k_d, 1/s; `damping_std_dev` l_d, m; `damping_robustness_eps` eps_d;
    `damping_velocity_gate_length_scale` v_d, m/s; `repulsion_gain` k_p, m/s^2; `repulsion_std_dev` l_p, m;
    `metric_modulation_radius` r, m; `metric_scalar` mu; `metric_exploder_std_dev` l_m, m; `metric_exploder_eps` eps_m.
    **Raises** `ConfigurationError` for a negative number, or a length, eps or radius that is zero.

    >>> near, far = Collision()(jnp.array([0.01, 0.1]), jnp.zeros(2)).f
    >>> bool(near > 1e3 * far)
    True

    NVIDIA, Lula RMPflow, `collision_rmp`; `point_cloud_obstacle_rmp` is the same with other constants.
    """

    damping_gain: NonNegative[jax.Array | float] = 50.0
    damping_std_dev: Positive[jax.Array | float] = 0.04
    damping_robustness_eps: Positive[jax.Array | float] = 1e-2
    damping_velocity_gate_length_scale: Positive[jax.Array | float] = 0.01
    repulsion_gain: NonNegative[jax.Array | float] = 800.0
    repulsion_std_dev: Positive[jax.Array | float] = 0.01
    metric_modulation_radius: Positive[jax.Array | float] = 0.5
    metric_scalar: NonNegative[jax.Array | float] = 10000.0
    metric_exploder_std_dev: Positive[jax.Array | float] = 0.02
    metric_exploder_eps: Positive[jax.Array | float] = 1e-3
    name: str = static(default="collision")
    certified = False

    def gap(self, x: jax.Array) -> jax.Array:
        """The smallest of the distances `x` [m], for the inspector."""
        return jnp.min(x)

    def evaluate(self, x, xd):
        d = jnp.maximum(x, 0)
        gate = closed_gate(xd / self.damping_velocity_gate_length_scale)
        brake = self.damping_gain * gate * xd / (d / self.damping_std_dev + self.damping_robustness_eps)
        a = self.repulsion_gain * jnp.exp(-d / self.repulsion_std_dev) - brake
        fade = jnp.maximum(1 - d / self.metric_modulation_radius, 0) ** 2
        m = gate * fade * self.metric_scalar / (d / self.metric_exploder_std_dev + self.metric_exploder_eps)
        return elementwise(a, m, x)
