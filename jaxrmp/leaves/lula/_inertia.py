"""Weight without a wish."""

import jax
import jax.numpy as jnp

from ..._pytree import pytree, static
from ..._ranges import NonNegative
from ..._tree import SeparableLeaf
from ._elementwise import elementwise


@pytree
class Inertia(SeparableLeaf):
    """Resists every acceleration alike: `a = 0`, `M = m I`.

    **Arguments**: `inertia` m.
    **Raises** `ConfigurationError` for a negative number.

    >>> Inertia(3.0)(jnp.zeros(2), jnp.ones(2)).M.tolist()
    [[3.0, 0.0], [0.0, 3.0]]

    NVIDIA, Lula RMPflow: `inertia` of `cspace_target_rmp` (on q) and of `damping_rmp` (on the target frame).
    """

    inertia: NonNegative[jax.Array | float] = 1.0
    name: str = static(default="inertia")
    certified = False

    def evaluate(self, x, xd):
        return elementwise(jnp.zeros_like(x), self.inertia, x)
