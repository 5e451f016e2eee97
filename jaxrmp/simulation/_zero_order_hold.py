"""Learned leaves at a lower rate than the rest of the tree, as on the paper's robot: 50 Hz against 1 kHz."""

from typing import Any

import jax
import jax.numpy as jnp

from .._forms import NaturalForm
from .._map_tree import Rebuild
from .._pytree import pytree
from .._tree import Batched, Leaf, Node
from .._visitor import Gather
from ..leaves import Learned


@pytree
class Held(Leaf):
    """A natural form as it was at an earlier instant, whatever the state is now: `form`.

    Between two evaluations it is no geometric dynamical system: its energy counts as zero and it certifies nothing.
    """

    form: NaturalForm
    name = "held"
    certified = False

    def __call__(self, x, xd):
        return self.form


def learned_forms(tree: Node, q: jax.Array, qd: jax.Array) -> tuple[NaturalForm, ...]:
    """The natural forms `[f, M]` of a tree's learned leaves, each in its own task space, at one state.

    **Arguments**: `tree`, a node on joint space; `q` [n], rad or m; `qd` [n], per second.
    """
    return tree.accept(_Forms(), (q, qd))


def with_held(tree: Node, forms: tuple[NaturalForm, ...]) -> Node:
    """The same tree with its learned leaves replaced by what `learned_forms` gave; task maps and the rest are live.

    So the held force and metric act in task space through the present Jacobian: `f = J^T (f_held - M_held Jdot qd)`.

    **Arguments**: `tree`, of the same structure; `forms`, of `learned_forms`.
    """
    return tree.accept(_Hold(forms), None)


class _Forms(Gather):
    """The forms of the learned leaves at a state `(x, xd)`."""

    def visit_leaf(self, leaf, state):
        return (leaf(*state),) if isinstance(leaf, Learned) else ()

    def visit_pullback(self, task_map, node, state):
        return node.accept(self, jax.jvp(task_map, *((part,) for part in state))) if _learns(node) else ()


class _Hold(Rebuild):
    """The tree with forms, taken one by one, in the place of learned leaves."""

    def __init__(self, forms: tuple[NaturalForm, ...]):
        super().__init__(lambda leaf: Held(self._left.pop(0)) if isinstance(leaf, Learned) else leaf)
        self._left = list(forms)

    def visit_batched(self, node, shared, state):
        if shared and _learns(node):  # what is held is each point's own
            K = self._left[0].f.shape[0]
            node, shared = jax.tree.map(lambda a: jnp.broadcast_to(a, (K, *jnp.shape(a))), node), False
        return Batched(node.accept(self, state), shared)


def _learns(node: Any) -> bool:
    return any(isinstance(leaf, Learned) for leaf in node.leaves())
