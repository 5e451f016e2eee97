"""Leaves that can be switched off while the policy runs, without compiling it again."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp

from .._pytree import pytree, static
from .._tree import Batched, Leaf, Node, Pullback, Sum
from ..inspection import gap


@pytree
class Switched(Leaf):
    """A leaf of which a `share` counts, 0 to 1: force, metric, energy and dissipation alike.

    A scaled geometric dynamical system is one too, so the certificate holds for every share that stays as it is.
    """

    leaf: Leaf
    share: jax.Array | float
    name: str = static(default="")

    @property
    def certified(self):
        return self.leaf.certified

    @property
    def has_goal(self):
        return self.leaf.has_goal

    def __call__(self, x, xd):
        return self.evaluate(x, xd).dense()

    def evaluate(self, x, xd):
        return jax.tree.map(lambda a: a * jnp.asarray(self.share, a.dtype), self.leaf.evaluate(x, xd))

    def energy(self, x, xd):
        return self.share * self.leaf.energy(x, xd)

    def dissipation(self, x, xd):
        return self.share * self.leaf.dissipation(x, xd)

    def gap(self, x):
        return gap(self.leaf, x)


def switches(tree: Node) -> tuple[str, ...]:
    """The names of a tree's switches: of each leaf one, of a batched leaf with parameters of its own for each of K
    points K, named as the inspector names them."""
    return tuple(name for leaf, count in _leaves(tree, None) for name in _names(leaf, count))


def switched(tree: Node, shares: jax.Array) -> Node:
    """The same tree with every leaf `Switched`; `shares` [S], one for each of `switches(tree)`."""
    return _switched(tree, shares, 0, None)[0]


def _names(leaf: Any, count: int | None) -> tuple[str, ...]:
    name = getattr(leaf, "name", type(leaf).__name__)
    return (name,) if count is None else tuple(f"{name}[{k}]" for k in range(count))


def _leaves(node: Node, count: int | None) -> list[tuple[Any, int | None]]:
    if isinstance(node, Sum):
        return [found for term in node.nodes for found in _leaves(term, count)]
    if isinstance(node, Pullback):
        return _leaves(node.node, count)
    if isinstance(node, Batched):
        return _leaves(node.node, count if node.shared else _points(node))
    return [(node, count)]


def _switched(node: Node, shares: jax.Array, at: int, count: int | None) -> tuple[Node, int]:
    """The node with its leaves switched by `shares[at:]`, and where those of the next node begin."""
    if isinstance(node, Sum):
        terms = []
        for term in node.nodes:
            term, at = _switched(term, shares, at, count)
            terms.append(term)
        return Sum(tuple(terms)), at
    if isinstance(node, Pullback):
        inner, at = _switched(node.node, shares, at, count)
        return Pullback(node.task_map, inner), at
    if isinstance(node, Batched):
        inner, at = _switched(node.node, shares, at, count if node.shared else _points(node))
        return dataclasses.replace(node, node=inner), at
    name = getattr(node, "name", type(node).__name__)
    end = at + (1 if count is None else count)
    return Switched(node, shares[at] if count is None else shares[at:end], name), end


def _points(node: Batched) -> int:
    return jnp.shape(jax.tree.leaves(node.node)[0])[0]
