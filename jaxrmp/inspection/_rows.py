"""The walk from the root to the leaves, and of the leaves' forms back to the root."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np

from .._pytree import pytree, static
from .._task_map import pushforward
from .._tree import Batched, Node, Pullback, Sum
from ._gap import gap


@pytree
class Rows:
    """R equal leaves, seen from some node above them: their forms there, and their states in their own space.

    `f` [R, ..., m] and `M` [R, ..., m, m] as forms on the node's space; `x`, `xd` [R, ...]; `energy`, `dissipation`,
    `gap` [R]. Where the node's space is one of points, `at` says which point each row acts on, as index arrays [R], one
    for each axis of points; empty if every row acts on all of them.
    """

    f: jax.Array
    M: jax.Array
    x: jax.Array
    xd: jax.Array
    energy: jax.Array
    dissipation: jax.Array
    gap: jax.Array
    names: tuple[str, ...] = static()
    certified: bool = static()
    at: tuple[tuple[int, ...], ...] = static(default=())


def rows_of(node: Node, x: jax.Array, xd: jax.Array) -> list[Rows]:
    """The leaves below `node`, in order, with their forms on its space; every task map is evaluated once."""
    if isinstance(node, Sum):
        return [rows for term in node.nodes for rows in rows_of(term, x, xd)]
    if isinstance(node, Pullback):
        there = pushforward(node.task_map, x, xd)
        return [_pulled_back(rows, there, x.ndim) for rows in rows_of(node.node, there.y, there.yd)]
    if isinstance(node, Batched):
        axes = (None if node.shared else 0, 0, 0)
        return [_point_by_point(rows) for rows in jax.vmap(rows_of, in_axes=axes)(node.node, x, xd)]
    form = node(x, xd)
    values = (form.f, form.M, x, xd, node.energy(x, xd), node.dissipation(x, xd), gap(node, x))
    certified = all(leaf.certified for leaf in node.leaves())
    rows = tuple(a[None] for a in values)
    return [Rows(*rows, names=(getattr(node, "name", type(node).__name__),), certified=certified)]


def _pulled_back(rows: Rows, there, domain_axes: int) -> Rows:
    """`f = J^T (f_y - M_y c)`, `M = J^T M_y J`, row by row; summed over points if the domain is one vector."""
    at = tuple(np.asarray(index) for index in rows.at) or None
    J, c = there.J[at], there.c[at]  # indexed by None, they get one axis for all rows
    f = jnp.einsum("...ij,...i->...j", J, rows.f - jnp.einsum("...ij,...j->...i", rows.M, c))
    M = jnp.swapaxes(J, -1, -2) @ rows.M @ J
    if domain_axes > 1:
        return _replace(rows, f, M, rows.at)
    points = tuple(range(1, f.ndim - 1))
    return _replace(rows, f.sum(points), M.sum(points), ())


def _point_by_point(rows: Rows) -> Rows:
    """Rows [K, R] of K points as K R rows, each acting on its own point."""
    K, R = rows.energy.shape
    flat = jax.tree.map(lambda a: a.reshape(K * R, *a.shape[2:]), rows)
    names = names_of_points(rows.names, K)
    at = (tuple(k for k in range(K) for _ in range(R)), *(index * K for index in rows.at))
    return Rows(flat.f, flat.M, flat.x, flat.xd, flat.energy, flat.dissipation, flat.gap, names, rows.certified, at)


def names_of_points(names: tuple[str, ...], K: int) -> tuple[str, ...]:
    """Names of the leaves of one point as those of K points, point by point: `name[k]`."""
    return tuple(f"{name}[{k}]" for k, name in itertools.product(range(K), names))


def _replace(rows: Rows, f: jax.Array, M: jax.Array, at: tuple) -> Rows:
    return Rows(f, M, rows.x, rows.xd, rows.energy, rows.dissipation, rows.gap, rows.names, rows.certified, at)
