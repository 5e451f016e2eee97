"""Geometric dynamical systems: the leaves that carry a Lyapunov certificate.

`M xdd = -grad Phi - B xd - xi` with `M = G + Xi`, for a metric G(x, xd), a potential Phi(x), a damping B(x, xd), and
the curvature terms `Xi = 1/2 sum_i xd_i d g_i / d xd` and `xi = (d/dt G at fixed xd) xd - 1/2 grad_x (xd^T G xd)`, all
by autodiff. Then `V = 1/2 xd^T G xd + Phi` falls at the rate `xd^T B xd`. RMPflow (Cheng et al. 2018), section 4.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from ._forms import DiagonalForm, NaturalForm
from ._linalg import matmul
from ._pytree import as_pytree, pytree, set_field, static
from ._tree import Leaf, SeparableLeaf
from .xla import one_loop


class GeometricDynamicalSystem(Leaf):
    """A leaf given by metric, potential and damping on a space [m]: those of a subclass, or functions given to `of`.

    Where the metric depends on velocity and m > 1, `M = G + Xi` need not be symmetric: resolve with `method="lu"`.
    """

    damping_rate: Any

    @staticmethod
    def of(metric: Callable, potential: Callable, damping: Callable, name: str = "gds") -> "GeometricDynamicalSystem":
        """A geometric dynamical system from any three functions.

        **Arguments**: `metric`, `(x, xd) -> G` [m, m]; `potential`, `x -> Phi`; `damping`, `(x, xd) -> B` [m, m];
        `name`. What a `jax.tree_util.Partial` holds are parameters; another plain function is another program.

        >>> spring = GeometricDynamicalSystem.of(
        ...     metric=lambda x, xd: jnp.eye(1), potential=lambda x: 2.0 * x @ x, damping=lambda x, xd: 3.0 * jnp.eye(1)
        ... )
        >>> spring(jnp.ones(1), jnp.ones(1)).f.tolist()
        [-7.0]
        """
        return _OfFunctions(metric, potential, damping, name)

    def metric(self, x: jax.Array, xd: jax.Array) -> jax.Array:
        """`G` [m, m] at `x, xd` [m], symmetric and positive semi-definite."""
        raise NotImplementedError

    def potential(self, x: jax.Array) -> jax.Array:
        """`Phi` at `x` [m], a scalar, bounded from below."""
        raise NotImplementedError

    def damping(self, x: jax.Array, xd: jax.Array) -> jax.Array:
        """`B` [m, m] at `x, xd` [m], positive semi-definite; here, `damping_rate` times the metric."""
        return (self.damping_rate * self.metric(x, xd)).astype(x.dtype)

    def __call__(self, x, xd):
        def momentum(x, v):
            return matmul(self.metric(x, v), xd)

        def twice_kinetic_energy(x):
            return _square(xd, self.metric(x, xd))

        Xi = 0.5 * jax.jacfwd(momentum, argnums=1)(x, xd)
        _, G_dot_xd = jax.jvp(lambda x: momentum(x, xd), (x,), (xd,))
        xi = G_dot_xd - 0.5 * jax.grad(twice_kinetic_energy)(x)
        f = -jax.grad(self.potential)(x) - matmul(self.damping(x, xd), xd) - xi
        return NaturalForm(f, self.metric(x, xd) + Xi)

    def energy(self, x, xd):
        return 0.5 * _square(xd, self.metric(x, xd)) + self.potential(x)

    def dissipation(self, x, xd):
        return _square(xd, self.damping(x, xd))


class SeparableGDS(SeparableLeaf):
    """Many one-dimensional geometric dynamical systems side by side: coordinate i of x [m] is a system of its own.

    Subclasses implement `metric`, `potential` and `damping` elementwise, [m] to [m]. One pass of elementwise autodiff
    serves all coordinates, so this is the form for joint limits and distances.
    """

    weight: Any
    damping_rate: Any

    def metric(self, x: jax.Array, xd: jax.Array) -> jax.Array:
        """The diagonal of `G`, [m], at `x, xd` [m]; entry i depends on `x[i]` and `xd[i]` alone; not negative; here,
        `weight`."""
        return jnp.broadcast_to(jnp.asarray(self.weight, x.dtype), x.shape)

    def potential(self, x: jax.Array) -> jax.Array:
        """The terms of `Phi`, [m], at `x` [m]; entry i depends on `x[i]` alone."""
        raise NotImplementedError

    def damping(self, x: jax.Array, xd: jax.Array) -> jax.Array:
        """The diagonal of `B`, [m], at `x, xd` [m]; not negative; here, `damping_rate` times the metric."""
        return (self.damping_rate * self.metric(x, xd)).astype(x.dtype)

    @one_loop
    def evaluate(self, x, xd):
        ones = jnp.ones_like(x)
        G, dG_dx = jax.jvp(lambda x: self.metric(x, xd), (x,), (ones,))
        _, dG_dxd = jax.jvp(lambda xd: self.metric(x, xd), (xd,), (ones,))
        _, slope = jax.jvp(self.potential, (x,), (ones,))
        f = -slope - self.damping(x, xd) * xd - 0.5 * xd * xd * dG_dx
        return DiagonalForm(f, G + 0.5 * xd * dG_dxd)

    def energy(self, x, xd):
        return jnp.sum(0.5 * self.metric(x, xd) * xd * xd + self.potential(x))

    def dissipation(self, x, xd):
        return jnp.sum(self.damping(x, xd) * xd * xd)


def _square(xd, A):
    """`xd^T A xd`."""
    return matmul(matmul(xd, A), xd)


@pytree
class _OfFunctions(GeometricDynamicalSystem):
    metric_of: Callable[[jax.Array, jax.Array], jax.Array]
    potential_of: Callable[[jax.Array], jax.Array]
    damping_of: Callable[[jax.Array, jax.Array], jax.Array]
    name: str = static(default="gds")

    def __post_init__(self):
        for name in ("metric_of", "potential_of", "damping_of"):
            set_field(self, name, as_pytree(getattr(self, name)))

    def metric(self, x, xd):
        return self.metric_of(x, xd)

    def potential(self, x):
        return self.potential_of(x)

    def damping(self, x, xd):
        return self.damping_of(x, xd)
