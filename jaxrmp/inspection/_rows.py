"""A row for each leaf: its state in its own space, and its share of what the tree does at the root."""

import itertools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from .._forms import DiagonalForm
from .._linalg import einsum, matmul
from .._pytree import pytree, static
from .._task_map import pushforward
from .._visitor import Gather, scaled


@pytree
class Rows:
    """R equal leaves, seen from some node above them: their forms there, and their states in their own space.

    `f` [R, ..., m] and `M` [R, ..., m, m] as forms on the node's space; `x`, `xd` [R, ...]; `energy`, `dissipation`,
    `gap` [R]. Where the node's space is one of points, `at` says which point each row acts on, as index arrays [R], one
    for each axis of points; empty if every row acts on all of them. `diagonal`: M is the diagonals [R, ..., m] alone,
    of leaves on thousands of distances, say.
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
    diagonal: bool = static(default=False)

    def dense(self) -> "Rows":
        """The same with matrices for M."""
        if not self.diagonal:
            return self
        return replace(self, M=DiagonalForm(self.f, self.M).dense().M, diagonal=False)


class RowsOfLeaves(Gather):
    """The leaves below a node, with their forms on its space, as `Rows`."""

    def visit_leaf(self, leaf, state):
        form, energy, dissipation = leaf.measure(*state)
        diagonal = isinstance(form, DiagonalForm)
        M = jnp.broadcast_to(form.d, form.f.shape) if isinstance(form, DiagonalForm) else form.M
        values = (form.f, M, *state, energy, dissipation, leaf.gap(state[0]))
        return (Rows(*(a[None] for a in values), names=(leaf.name,), certified=leaf.certified, diagonal=diagonal),)

    def visit_pullback(self, task_map, node, state):
        there = pushforward(task_map, *state)
        return tuple(_pulled_back(rows, there, state[0].ndim) for rows in node.accept(self, (there.y, there.yd)))

    def visit_batched(self, node, shared, state):
        return tuple(map(_point_by_point, super().visit_batched(node, shared, state)))

    def visit_scaled(self, node, share, state):
        def part(rows):
            names = ("f", "M", "energy", "dissipation")
            return replace(rows, **scaled({name: getattr(rows, name) for name in names}, share))

        return tuple(map(part, node.accept(self, state)))


def _pulled_back(rows: Rows, there, domain_axes: int) -> Rows:
    """`f = J^T (f_y - M_y c)`, `M = J^T M_y J`, row by row; summed over points if the domain is one vector."""
    at = tuple(np.asarray(index) for index in rows.at) or None
    J, c = there.J[at], there.c[at]  # indexed by None, they get one axis for all rows
    Mc = rows.M * c if rows.diagonal else einsum("...ij,...j->...i", rows.M, c)
    MJ = rows.M[..., None] * J if rows.diagonal else matmul(rows.M, J)
    f = einsum("...ij,...i->...j", J, rows.f - Mc)
    M = matmul(jnp.swapaxes(J, -1, -2), MJ)
    if domain_axes > 1:
        return replace(rows, f=f, M=M, diagonal=False)
    points = tuple(range(1, f.ndim - 1))
    return replace(rows, f=f.sum(points), M=M.sum(points), at=(), diagonal=False)


def _point_by_point(rows: Rows) -> Rows:
    """Rows [K, R] of K points as K R rows, each acting on its own point."""
    K, R = rows.energy.shape
    flat = jax.tree.map(lambda a: a.reshape(K * R, *a.shape[2:]), rows)
    at = (tuple(k for k in range(K) for _ in range(R)), *(index * K for index in rows.at))
    return replace(flat, names=names_of_points(rows.names, K), at=at)


def names_of_points(names: tuple[str, ...], K: int) -> tuple[str, ...]:
    """Names of the leaves of one point as those of K points, point by point: `name[k]`."""
    return tuple(f"{name}[{k}]" for k, name in itertools.product(range(K), names))
