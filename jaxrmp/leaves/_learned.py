"""The leaf that reproduces demonstrations."""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from .._forms import NaturalForm
from .._gds import GeometricDynamicalSystem
from .._linalg import matmul, solve_lower, solve_lower_transposed
from .._pytree import as_pytree, pytree, set_field, static
from .._ranges import NonNegative


@pytree
class Learned(GeometricDynamicalSystem):
    """Follows demonstrations to their common end at the origin of its space, from wherever it is.

    `M = L L^T` with `L = cholesky_of(x)` warps the gradient of a potential: the first-order field `-M^-1 grad Phi` is
    what was fitted. As a second-order policy, `M xdd = -speed damping_rate grad Phi - damping_rate M xd - xi`: it
    cruises at `speed` times that field, and follows it the closer the larger `damping_rate` is.

    **Arguments**: `potential_of`, `x -> Phi`, slope about 1; `cholesky_of`, `x -> L` [m, m], lower triangular with
    positive diagonal; `speed`, m/s; `damping_rate`, 1/s. `potential_of` and `cholesky_of` are callable pytrees.
    **Raises** `ConfigurationError` for a negative speed or rate.

    >>> from jax.tree_util import Partial
    >>> leaf = Learned(Partial(lambda x: 0.5 * x @ x), Partial(lambda x: jax.numpy.eye(2)))
    >>> leaf.field(jax.numpy.array([3.0, 4.0])).tolist()
    [-3.0, -4.0]

    Rana et al. 2019, equations 1 and 8.
    """

    potential_of: Callable[[jax.Array], jax.Array]
    cholesky_of: Callable[[jax.Array], jax.Array]
    speed: NonNegative[jax.Array | float] = 0.2
    damping_rate: NonNegative[jax.Array | float] = 20.0
    name: str = static(default="learned")
    has_goal = True

    def __post_init__(self):
        for name in ("potential_of", "cholesky_of"):
            set_field(self, name, as_pytree(getattr(self, name)))

    def __call__(self, x, xd):
        # G = L L^T does not depend on velocity: its curvature terms take one pass along xd and one pass back.
        L, back = jax.vjp(self.cholesky_of, x)
        _, L_dot = jax.jvp(self.cholesky_of, (x,), (xd,))
        M, momentum = matmul(L, L.T), matmul(L.T, xd)
        (kinetic_slope,) = back(jnp.outer(xd, momentum))
        xi = matmul(L_dot, momentum) + matmul(L, matmul(L_dot.T, xd)) - kinetic_slope
        f = -jax.grad(self.potential)(x) - self.damping_rate * matmul(M, xd) - xi
        return NaturalForm(f.astype(x.dtype), M.astype(x.dtype))

    def metric(self, x, xd):
        L = self.cholesky_of(x)
        return matmul(L, L.T)

    def potential(self, x):
        return (self.speed * self.damping_rate * self.potential_of(x)).astype(x.dtype)

    def field(self, x: jax.Array) -> jax.Array:
        """The learned first-order field `-M^-1 grad Phi` [m] at `x` [m], of about unit length away from the goal."""
        return natural_gradient_field(self.cholesky_of(x), jax.grad(self.potential_of)(x))


def natural_gradient_field(L: jax.Array, slope: jax.Array) -> jax.Array:
    """`-M^-1 slope` for `M = L L^T`, by forward and back substitution; `L` [..., m, m], `slope` [..., m]."""
    return -solve_lower_transposed(L, solve_lower(L, slope))
