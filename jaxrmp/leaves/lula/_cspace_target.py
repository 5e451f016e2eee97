"""The pull of all joints towards a posture."""

import jax
import jax.numpy as jnp

from ..._linalg import length
from ..._pytree import pytree, static
from ..._ranges import Finite, NonNegative, Positive
from ..._tree import SeparableLeaf
from ._elementwise import elementwise


@pytree
class CSpaceTarget(SeparableLeaf):
    """Pulls the joints towards `target`, with a pull that grows no more beyond a distance.

    `a = k_p rob(q_0 - q) - k_d qd`, `M = mu I`, with `rob(p) = p` for `|p| < theta`, else `theta p / |p|`.

    **Arguments**: `target` q_0 [n], rad or m; `metric_scalar` mu; `position_gain` k_p, 1/s^2; `damping_gain` k_d, 1/s;
    `robust_position_term_thresh` theta, units of q.
    **Raises** `ConfigurationError` for a negative number, or a threshold that is zero.

    >>> CSpaceTarget(target=jnp.zeros(2))(jnp.array([0.25, 0.0]), jnp.zeros(2)).f.tolist()
    [-1250.0, 0.0]

    NVIDIA, Lula RMPflow, `cspace_target_rmp`; its `inertia` is a leaf of its own, `Inertia`.
    """

    target: Finite[jax.Array]
    metric_scalar: NonNegative[jax.Array | float] = 50.0
    position_gain: NonNegative[jax.Array | float] = 100.0
    damping_gain: NonNegative[jax.Array | float] = 50.0
    robust_position_term_thresh: Positive[jax.Array | float] = 0.5
    name: str = static(default="cspace_target")
    certified = False
    _place = "target"

    def evaluate(self, x, xd):
        offset = jnp.asarray(self.target, x.dtype) - x
        offset = offset / jnp.maximum(1.0, length(offset) / self.robust_position_term_thresh)
        return elementwise(self.position_gain * offset - self.damping_gain * xd, self.metric_scalar, x)
