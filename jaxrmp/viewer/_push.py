"""A hand that pulls at the arm from outside."""

import jax
import jax.numpy as jnp

from .._gds import GeometricDynamicalSystem
from .._linalg import matmul
from .._pytree import pytree, static


@pytree
class Push(GeometricDynamicalSystem):
    """A spring from a point of the arm, x [3], to a point in space, without inertia: `f = -k (x - goal) - c xd`.

    It is a leaf, so its force reaches the joints through the Jacobian, `tau = J^T f`, and its energy is in the
    certificate: what the arm gains while it is pulled is what the spring gives.

    **Arguments**: `goal` [3], m; `stiffness` k and `damping_rate` c, per unit of the policy's metric at that point
    times one over s^2 and s. A stiffness and damping of zero let go.
    """

    goal: jax.Array
    stiffness: jax.Array | float = 0.0
    damping_rate: jax.Array | float = 0.0
    name: str = static(default="push")

    def metric(self, x, xd):
        return jnp.zeros((3, 3), x.dtype)

    def potential(self, x):
        offset = x - jnp.asarray(self.goal, x.dtype)
        return (0.5 * self.stiffness * matmul(offset, offset)).astype(x.dtype)

    def damping(self, x, xd):
        return (self.damping_rate * jnp.eye(3, dtype=x.dtype)).astype(x.dtype)
