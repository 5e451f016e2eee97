"""The same tree with its leaves and its task maps exchanged."""

from collections.abc import Callable
from typing import Any

import jax

from ._tree import Batched, Leaf, Node, Pullback, Scaled, Sum
from ._visitor import Visitor


class Rebuild(Visitor):
    """Builds the tree anew, with what functions make of its leaves and task maps, or as it is; to be overridden where
    it shall differ more. The state goes down unchanged."""

    def __init__(self, leaf: Callable | None = None, task_map: Callable | None = None):
        self._leaf, self._task_map = leaf, task_map

    def visit_leaf(self, leaf: Leaf, state: Any) -> Node:
        return leaf if self._leaf is None else self._leaf(leaf)

    def visit_sum(self, nodes, state):
        return Sum(tuple(node.accept(self, state) for node in nodes))

    def visit_pullback(self, task_map, node, state):
        return Pullback(task_map if self._task_map is None else self._task_map(task_map), node.accept(self, state))

    def visit_batched(self, node, shared, state):
        if shared:
            return Batched(node.accept(self, state), shared=True)
        return Batched(jax.vmap(lambda node: node.accept(self, state))(node))

    def visit_scaled(self, node, share, state):
        return Scaled(node.accept(self, state), share)


def map_tree(
    tree: Node, leaf: Callable[[Leaf], Node] | None = None, task_map: Callable[[Callable], Callable] | None = None
) -> Node:
    """The same tree, each of its leaves and task maps replaced by what a function makes of it.

    **Arguments**: `tree`; `leaf`, from a leaf to the node in its place, such as `Scaled(leaf, 0.0)`, which switches it
    off, or `dataclasses.replace(leaf, goal=...)`; by default leaves stay. Below a `Batched` node it sees one point's.
    `task_map`, from a task map to the one in its place; by default they stay.
    **Returns** a new tree.

    >>> import jax.numpy as jnp
    >>> from jaxrmp.leaves import Damping, Posture
    >>> tree = Posture(jnp.ones(2)) + Damping(weight=1.0)
    >>> off = map_tree(tree, lambda leaf: Scaled(leaf, 0.0) if leaf.name == "posture" else leaf)
    >>> off(jnp.zeros(2), jnp.zeros(2)).M[0].tolist()
    [1.0, 0.0]
    """
    return tree.accept(Rebuild(leaf, task_map), None)
