"""The Lyapunov certificate that a tree of geometric dynamical systems carries."""

import jax

from ._forms import Method, resolve
from ._pytree import pytree, static
from ._tree import Node
from ._visitor import Measurement
from .xla import in_lanes


@pytree
class Certificate:
    """`energy` V, its rate of change under the resolved policy `dV_dt`, and the tree's `dissipation`, all scalars.

    `dV_dt = -dissipation <= 0` wherever the root metric is invertible and every leaf is certified; `residual`, the
    distance from that law relative to `1 + |V|`, is then rounding. `voided_by` names the leaves that are not certified:
    the law proves stability only if it is empty. It is structure, so it comes out of `jit` and `vmap` as it is.
    """

    energy: jax.Array
    dV_dt: jax.Array
    dissipation: jax.Array
    voided_by: tuple[str, ...] = static()

    @property
    def residual(self) -> jax.Array:
        """`|dV_dt + dissipation| / (1 + |V|)`."""
        return abs(self.dV_dt + self.dissipation) / (1 + abs(self.energy))


@in_lanes
def certificate(tree: Node, x: jax.Array, xd: jax.Array, method: Method = "cholesky") -> Certificate:
    """Evaluate the certificate of a tree at one state.

    **Arguments**: `tree`, a node; `x` and `xd` [n], a state of its space; `method`, how the acceleration is resolved.
    **Returns** a `Certificate`. `dV_dt` is the derivative of the energy along the motion `(xd, xdd)`, taken by
    autodiff, not assumed.

    >>> import jax.numpy as jnp
    >>> from jaxrmp.leaves import Damping
    >>> found = certificate(Damping(weight=1.0, damping_rate=2.0), jnp.zeros(2), jnp.ones(2))
    >>> float(found.energy), float(found.dV_dt), float(found.dissipation), found.voided_by
    (1.0, -4.0, 4.0, ())

    RMPflow (Cheng et al. 2018), theorem 2.
    """
    found = tree.accept(Measurement(form=True, dissipation=True), (x, xd))
    xdd = resolve(found.form.dense(), method)
    energy, dV_dt = jax.jvp(tree.energy, (x, xd), (xd, xdd))
    return Certificate(energy, dV_dt, found.dissipation, uncertified_leaves(tree))


def uncertified_leaves(tree: Node) -> tuple[str, ...]:
    """Names, each once, of the leaves that are not geometric dynamical systems and so void the tree's certificate.

    What `certificate` reports of `tree` as `voided_by`, without a state and without computing anything.
    """
    return tuple(dict.fromkeys(leaf.name for leaf in tree.leaves() if not leaf.certified))
