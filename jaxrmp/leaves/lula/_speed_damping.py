"""The brake on a frame that grows with its speed."""

import jax

from ..._linalg import length
from ..._pytree import pytree, static
from ..._ranges import NonNegative
from ..._tree import SeparableLeaf
from ._elementwise import elementwise


@pytree
class SpeedDamping(SeparableLeaf):
    """Brakes a point in space the harder, and the more importantly, the faster it moves.

    `a = -k_d |xd| xd`, `M = mu |xd| I`: nothing at rest.

    **Arguments**: `accel_d_gain` k_d, 1/m; `metric_scalar` mu, s/m.
    **Raises** `ConfigurationError` for a negative number.

    >>> import jax.numpy as jnp
    >>> float(SpeedDamping()(jnp.zeros(3), jnp.array([1.0, 0.0, 0.0])).f[0])
    -1500.0

    NVIDIA, Lula RMPflow, `damping_rmp`; its `inertia` is a leaf of its own, `Inertia`.
    """

    accel_d_gain: NonNegative[jax.Array | float] = 30.0
    metric_scalar: NonNegative[jax.Array | float] = 50.0
    name: str = static(default="damping")
    certified = False

    def evaluate(self, x, xd):
        speed = length(xd)
        return elementwise(-self.accel_d_gain * speed * xd, self.metric_scalar * speed, x)
