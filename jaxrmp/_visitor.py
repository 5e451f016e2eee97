"""One walk over a tree for whatever is asked of it: down from the root with a state, and up again with what was found.

A node says in `accept` what it is made of, a visitor what that means for its question. So a new kind of node, which
puts itself into these words, is at once evaluated, certified, inspected, held and switched; and a new question is one
class, which knows no kind of node.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ._errors import ShapeError
from ._forms import DiagonalForm
from ._task_map import transport

if TYPE_CHECKING:
    from ._tree import Leaf, Node


class Visitor:
    """A question to a tree. What it carries down, `state`, and what it brings up are its own affair."""

    def visit_leaf(self, leaf: "Leaf", state: Any) -> Any:
        """A `leaf`; `state`, what the walk carries: where it is on the leaf's space, for instance."""
        raise NotImplementedError

    def visit_sum(self, nodes: "tuple[Node, ...]", state: Any) -> Any:
        """`nodes` that act together on the same space; `state`, as in `visit_leaf`."""
        raise NotImplementedError

    def visit_pullback(self, task_map: Any, node: "Node", state: Any) -> Any:
        """A `node` on another space, behind a `task_map`; `state`, as in `visit_leaf`."""
        raise NotImplementedError

    def visit_batched(self, node: "Node", shared: bool, state: Any) -> Any:
        """A `node` at each of K points of `state`, its parameters with a leading axis of K unless `shared`."""
        raise NotImplementedError

    def visit_scaled(self, node: "Node", share: Any, state: Any) -> Any:
        """A `node` of which a `share` counts; to most questions, the node. `state`, as in `visit_leaf`."""
        return node.accept(self, state)


class Measured(NamedTuple):
    """What a node gives at a state: its natural `form`, with the structure of its metric kept, its `energy`, and its
    `dissipation`, per second; None where it was not asked for."""

    form: Any
    energy: Any
    dissipation: Any


class Measurement(Visitor):
    """Form, energy and dissipation at a state `(x, xd)`, those that are `wanted`, every task map evaluated once."""

    def __init__(self, form: bool = False, energy: bool = False, dissipation: bool = False):
        self.wanted = Measured(form, energy, dissipation)

    def visit_leaf(self, leaf, state):
        if all(self.wanted):
            return leaf.measure(*state)
        functions = (leaf.evaluate, leaf.energy, leaf.dissipation)
        return Measured(*(of(*state) if w else None for of, w in zip(functions, self.wanted, strict=True)))

    def visit_sum(self, nodes, state):
        if not nodes:
            zeros, nothing = jnp.zeros_like(state[0]), jnp.zeros((), state[0].dtype)
            found = (DiagonalForm(zeros, zeros), nothing, nothing)
            return Measured(*(part if w else None for part, w in zip(found, self.wanted, strict=True)))
        total, *others = (node.accept(self, state) for node in nodes)
        for part in others:
            total = Measured(*(None if a is None else a + b for a, b in zip(total, part, strict=True)))
        return total

    def visit_pullback(self, task_map, node, state):
        if not self.wanted.form:
            return node.accept(self, jax.jvp(task_map, *((part,) for part in state)))
        y, yd, pull = transport(task_map, *state)
        there = node.accept(self, (y, yd))
        return there._replace(form=pull(there.form))

    def visit_batched(self, node, shared, state):
        form, *energies = at_points(self, node, shared, state)
        return Measured(form, *(None if energy is None else jnp.sum(energy) for energy in energies))

    def visit_scaled(self, node, share, state):
        return scaled(node.accept(self, state), share)


def scaled(values: Any, share: jax.Array | float) -> Any:
    """Every array of `values` times `share`, a scalar."""
    return jax.tree.map(lambda a: a * jnp.asarray(share, a.dtype), values)


def at_points(visitor: Visitor, node: "Node", shared: bool, state: Any) -> Any:
    """What a visitor finds below a batched node, all of it with a leading axis of K; `state`, arrays [K, ..., m].

    **Raises** `ShapeError` for coordinates that are no K points.
    """
    shape = jnp.shape(jax.tree.leaves(state)[0])
    K = None if shared else points_of(node)
    if len(shape) < 2 or K not in (None, shape[0]):
        raise ShapeError(f"x has shape {shape}, expected [{K or 'K'}, m]: a batched node acts on points.")
    # JAX's own arrays: it fails where a function with a derivative of its own meets NumPy's as constants under vmap.
    node = jax.tree.map(lambda a: jnp.asarray(a) if isinstance(a, np.ndarray) else a, node)
    return jax.vmap(lambda node, state: node.accept(visitor, state), in_axes=(None if shared else 0, 0))(node, state)


def points_of(node: "Node") -> int:
    """How many points a node's parameters are for."""
    return jnp.shape(jax.tree.leaves(node)[0])[0]


class Gather(Visitor):
    """Tuples of what is found at the leaves, in order."""

    def visit_sum(self, nodes, state):
        return tuple(part for node in nodes for part in node.accept(self, state))

    def visit_batched(self, node, shared, state):
        return at_points(self, node, shared, state)


class Leaves(Gather):
    """The leaves; without a state."""

    def visit_leaf(self, leaf, state):
        return (leaf,)

    def visit_pullback(self, task_map, node, state):
        return node.accept(self, state)

    def visit_batched(self, node, shared, state):
        return node.accept(self, state)
