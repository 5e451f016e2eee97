"""A tree evaluated once for its form, its energy and its dissipation together."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from .._forms import Form
from .._task_map import transport
from .._tree import Batched, Node, Pullback, Sum


class Measured(NamedTuple):
    """The natural `form` of a node with its `energy` and `dissipation`, as the node itself gives each of them."""

    form: Form
    energy: jax.Array
    dissipation: jax.Array


def measured(node: Node, x: jax.Array, xd: jax.Array) -> Measured:
    """What `node(x, xd)`, `node.energy(x, xd)` and `node.dissipation(x, xd)` give, with every task map evaluated once:
    a third of their time, and of what it takes to compile them."""
    if isinstance(node, Sum):
        parts = [measured(term, x, xd) for term in node.nodes]
        total = parts[0]
        for part in parts[1:]:
            total = Measured(*(a + b for a, b in zip(total, part, strict=True)))
        return total
    if isinstance(node, Pullback):
        y, yd, pull = transport(node.task_map, x, xd)
        there = measured(node.node, y, yd)
        return there._replace(form=pull(there.form))
    if isinstance(node, Batched):
        there = jax.vmap(measured, in_axes=(None if node.shared else 0, 0, 0))(node.node, x, xd)
        return there._replace(energy=jnp.sum(there.energy), dissipation=jnp.sum(there.dissipation))
    return Measured(node.evaluate(x, xd), node.energy(x, xd), node.dissipation(x, xd))
