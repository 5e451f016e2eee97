"""A way round: a slope before obstacles that turns motion to a goal aside."""

import jax
import jax.numpy as jnp

from .._forms import DiagonalForm
from .._gds import GeometricDynamicalSystem
from .._linalg import matmul
from .._pytree import pytree, static
from .._ranges import NonNegative, Positive

_STEEPEST = 1.875  # of the quintic step from 0 to 1


@pytree
class Detour(GeometricDynamicalSystem):
    """Makes places near obstacles cost more than places beside them, so that motion to a goal goes round; never felt at
    the goal itself.

    On `x = [z, d]`, where a point is from its goal, `z = p - goal` [3], m, and its distances `d` [O], m, to obstacles:
    `Phi = strength reach / 1.875 (1 - exp(-|z|^2 / taper^2)) sum_o b(d_o / reach)`, where b falls from 1 in contact to
    0 at reach by a quintic step, and so by `strength` at most. No metric, no damping: a potential alone, which needs
    another leaf for both. A barrier is a local minimum where what is pulled against it is blunt, as an open gripper
    against a ball; this slope begins before and is bent, since what is farther beside costs less. With less strength
    than the pull to the goal it cannot stop a motion by itself. If `d` are distances of the point a little aside, it
    leads to that side.

    **Arguments**: `strength`, N, beside the pull of tasks; `reach`, m, from obstacles on; `taper`, m, within which of
    the goal it fades.
    **Raises** `ConfigurationError` for a negative strength, or a reach or taper that is not positive.

    >>> leaf = Detour(strength=10.0)
    >>> x = jnp.array([0.5, 0.0, 0.0, 0.05])  # half a metre to go, and an obstacle 5 cm away
    >>> bool(leaf(x, jnp.zeros(4)).f[3] > 0), bool(leaf(x.at[0].set(0), jnp.zeros(4)).f.any())
    (True, False)

    Ours; docs/policies.md measures what it does.
    """

    strength: NonNegative[jax.Array | float]
    reach: Positive[jax.Array | float] = 0.15
    taper: Positive[jax.Array | float] = 0.05
    name: str = static(default="detour")

    def __call__(self, x, xd):
        return self.evaluate(x, xd).dense()

    def evaluate(self, x, xd):
        return DiagonalForm(-jax.grad(self.potential)(x), jnp.zeros_like(x))

    def metric(self, x, xd):
        return jnp.zeros((x.shape[0], x.shape[0]), x.dtype)

    def damping(self, x, xd):
        return jnp.zeros((x.shape[0], x.shape[0]), x.dtype)

    def potential(self, x):
        z, d = x[:3], x[3:]
        u = jnp.clip(d / self.reach, 0, 1)
        near = jnp.sum(1 - u**3 * (10 + u * (6 * u - 15)))
        away = -jnp.expm1(-matmul(z, z) / jnp.asarray(self.taper, x.dtype) ** 2)
        return (self.strength * self.reach / _STEEPEST * away * near).astype(x.dtype)
