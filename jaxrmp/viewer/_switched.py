"""Leaves that can be switched off while the policy runs, without compiling it again."""

import jax

from .._map_tree import Rebuild
from .._tree import Batched, Node, Scaled
from .._visitor import points_of


def switches(tree: Node) -> tuple[str, ...]:
    """The names of a tree's switches: of each leaf one, of a batched leaf with parameters of its own for each of K
    points K, named as the inspector names them."""
    found = _Switches(None)
    tree.accept(found, None)
    return tuple(found.names)


def switched(tree: Node, shares: jax.Array) -> Node:
    """The same tree with every leaf `Scaled`; `shares` [S], one for each of `switches(tree)`."""
    return tree.accept(_Switches(shares), None)


class _Switches(Rebuild):
    """Scales the leaves, one after the other; the state is how many points have parameters of their own, or None."""

    def __init__(self, shares: jax.Array | None):
        super().__init__()
        self.names: list[str] = []
        self._shares = shares

    def visit_leaf(self, leaf, state):
        first = len(self.names)
        self.names += [leaf.name] if state is None else [f"{leaf.name}[{k}]" for k in range(state)]
        if self._shares is None:
            return leaf
        return Scaled(leaf, self._shares[first] if state is None else self._shares[first : first + state])

    def visit_batched(self, node, shared, state):
        return Batched(node.accept(self, state if shared else points_of(node)), shared)
