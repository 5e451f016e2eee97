"""A preferred posture."""

import jax
import jax.numpy as jnp

from .._gds import SeparableGDS
from .._pytree import pytree, static
from .._ranges import Finite, NonNegative


@pytree
class Posture(SeparableGDS):
    """Draws joints to a posture where no task needs them: it decides among the configurations that serve a task.

    `M = w I`, `Phi = 1/2 w stiffness |q - rest|^2`, `B = damping_rate w I`: alone,
    `qdd = stiffness (rest - q) - damping_rate qd`, critically damped at `damping_rate = 2 sqrt(stiffness)`.

    **Arguments**: `rest` [n], rad or m; `weight` w, the metric, small next to that of tasks; `stiffness`, 1/s^2;
    `damping_rate`, 1/s. The gains may be numbers or [n].
    **Raises** `ConfigurationError` for a negative gain, or a rest that is not finite.

    >>> Posture(rest=jnp.ones(2), weight=1.0, stiffness=4.0)(jnp.zeros(2), jnp.zeros(2)).f.tolist()
    [4.0, 4.0]

    RMPflow (Cheng et al. 2018), the isotropic attractor with a constant metric.
    """

    rest: Finite[jax.Array]
    weight: NonNegative[jax.Array | float] = 1e-2
    stiffness: NonNegative[jax.Array | float] = 4.0
    damping_rate: NonNegative[jax.Array | float] = 4.0
    name: str = static(default="posture")
    _place = "rest"

    def potential(self, x):
        return (0.5 * self.weight * self.stiffness * (x - jnp.asarray(self.rest, x.dtype)) ** 2).astype(x.dtype)
