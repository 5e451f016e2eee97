"""How far a configuration is from every goal of a tree."""

import jax
import jax.numpy as jnp

from .._pytree import pytree, static
from .._tree import Batched, Leaf, Node, Pullback, Sum
from ._gap import gap
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
    found = _goals_of(tree, q)
    gaps = jnp.concatenate([jnp.zeros(0, q.dtype), *(part.gap for part in found)])
    return Goals(gaps, tuple(name for part in found for name in part.names))


def _goals_of(node: Node, x: jax.Array) -> list[Goals]:
    if not any(leaf.has_goal for leaf in node.leaves()):
        return []
    if isinstance(node, Sum):
        return [part for term in node.nodes for part in _goals_of(term, x)]
    if isinstance(node, Pullback):
        return _goals_of(node.node, node.task_map(x))
    if isinstance(node, Batched):
        return [_point_by_point(part) for part in jax.vmap(_goals_of, (None if node.shared else 0, 0))(node.node, x)]
    return [Goals(gap(node, x)[None], (node.name,))] if isinstance(node, Leaf) else []


def _point_by_point(part: Goals) -> Goals:
    """Gaps [K, R] of K points as K R gaps."""
    K = part.gap.shape[0]
    return Goals(part.gap.reshape(-1), names_of_points(part.names, K))
