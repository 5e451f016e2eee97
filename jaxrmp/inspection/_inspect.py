"""What each leaf of a tree contributes at one state."""

import jax
import jax.numpy as jnp

from .._forms import Method, NaturalForm, resolve
from .._linalg import length
from .._pytree import pytree, static
from .._tree import Node
from ._rows import RowsOfLeaves


@pytree
class Inspection:
    """The leaves of a tree at one state, one row each; points of a `Batched` node are rows of their own.

    `f` [R, n] and `M` [R, n, n], what each row adds to the root's force and metric; `acceleration` [R, n], the part
    `M_root^+ f` of the joint acceleration that it is responsible for; `force_share`, `|f_i| / sum_j |f_j|`, and
    `metric_share`, `trace M_i / trace M`, [R], both zero where there is nothing to share; `gap` [R], the distance to
    what the leaf is about, NaN if that is no place, see `Leaf.gap`; `energy` and `dissipation` [R], per
    second, zero for leaves that have none; `x` and `xd`, tuples of R arrays, position and velocity in the leaf's own
    space; `names` and `certified`, tuples of R, the names of a batched leaf's points with their index: `learned[2]`.
    """

    f: jax.Array
    M: jax.Array
    acceleration: jax.Array
    force_share: jax.Array
    metric_share: jax.Array
    gap: jax.Array
    energy: jax.Array
    dissipation: jax.Array
    x: tuple[jax.Array, ...]
    xd: tuple[jax.Array, ...]
    names: tuple[str, ...] = static()
    certified: tuple[bool, ...] = static()


def inspect(tree: Node, q: jax.Array, qd: jax.Array, method: Method = "cholesky") -> Inspection:
    """Take a tree's action at one state apart into its leaves.

    Forces, metrics, energies and dissipations of all rows sum to the tree's, and `acceleration` to `M^+ f`.

    **Arguments**: `tree`, a node on joint space; `q` [n], rad or m; `qd` [n], per second; `method`, how the
    acceleration is resolved, see `resolve`.
    **Returns** an `Inspection`. A whole rollout at once: `jax.jit(jax.vmap(inspect, (None, 0, 0)))(tree, path.q,
    path.qd)`, all arrays then with a leading axis of time.

    >>> from jaxrmp.leaves import Damping, Posture
    >>> found = inspect(Posture(jnp.ones(2)) + Damping(), jnp.zeros(2), jnp.zeros(2))
    >>> found.names, found.force_share.round(3).tolist()
    (('posture', 'damping'), [1.0, 0.0])
    """
    groups = [rows.dense() for rows in tree.accept(RowsOfLeaves(), (q, qd))]
    names = ("f", "M", "gap", "energy", "dissipation")
    found = {name: jnp.concatenate([getattr(rows, name) for rows in groups]) for name in names}
    f, M = found["f"], found["M"]
    size = length(f)
    trace = jnp.trace(M, axis1=-2, axis2=-1)
    return Inspection(
        **found,
        acceleration=resolve(NaturalForm(f, M.sum(0)), method),
        force_share=_share(size, size.sum()),
        metric_share=_share(trace, trace.sum()),
        x=tuple(x for rows in groups for x in rows.x),
        xd=tuple(xd for rows in groups for xd in rows.xd),
        names=tuple(name for rows in groups for name in rows.names),
        certified=tuple(rows.certified for rows in groups for _ in rows.names),
    )


def _share(part: jax.Array, whole: jax.Array) -> jax.Array:
    nothing = whole == 0  # and NaN stays NaN
    return jnp.where(nothing, 0, part / jnp.where(nothing, 1, whole))
