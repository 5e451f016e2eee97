"""How far a configuration is from every goal of a tree."""

import jax
import jax.numpy as jnp

from .._pytree import pytree, static
from .._tree import Node
from .._visitor import Gather
from ._rows import names_of_points


@pytree
class Goals:
    """The leaves of a tree that have a goal, G of them: `gap` [G], the distance left to each, and their `names`.

    Names and gaps are the inspector's: points of a `Batched` node count one by one, in units of the leaf's space.
    """

    gap: jax.Array
    names: tuple[str, ...] = static()


def goals(tree: Node, q: jax.Array) -> Goals:
    """The distance left to each goal of a tree at one configuration; evaluates only the task maps that lead to goals.

    A leaf has a goal if it says `has_goal = True`: attractors, learned leaves, formations, and Lula's position and axis
    targets. Postures, barriers, limits and damping have none: to be held off them, or near them, is no failure.

    **Arguments**: `tree`, a node on joint space; `q` [n], rad or m. **Returns** `Goals`.

    >>> from jaxrmp.leaves import Attractor, Damping
    >>> left = goals(Attractor(jnp.array([3.0, 4.0])) + Damping(), jnp.zeros(2))
    >>> left.names, left.gap.tolist()
    (('attractor',), [5.0])
    """
    found = tree.accept(_GoalsOfLeaves(), q)
    gaps = jnp.concatenate([jnp.zeros(0, q.dtype), *(part.gap for part in found)])
    return Goals(gaps, tuple(name for part in found for name in part.names))


class _GoalsOfLeaves(Gather):
    """`Goals` at a position."""

    def visit_leaf(self, leaf, state):
        return (Goals(leaf.gap(state)[None], (leaf.name,)),) if leaf.has_goal else ()

    def visit_pullback(self, task_map, node, state):
        return node.accept(self, task_map(state)) if any(leaf.has_goal for leaf in node.leaves()) else ()

    def visit_batched(self, node, shared, state):
        found = super().visit_batched(node, shared, state)  # gaps [K, R] of K points, which are K R gaps
        return tuple(Goals(part.gap.reshape(-1), names_of_points(part.names, len(part.gap))) for part in found)
