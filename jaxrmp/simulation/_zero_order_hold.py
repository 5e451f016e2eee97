"""Learned leaves at a lower rate than the rest of the tree, as on the paper's robot: 50 Hz against 1 kHz."""

from typing import Any

import jax

from .._forms import NaturalForm
from .._pytree import pytree
from .._task_map import pushforward
from .._tree import Node, Pullback, Sum
from ..leaves import Learned


@pytree
class Held(Node):
    """A natural form as it was at an earlier instant, whatever the state is now.

    Between two evaluations it is no geometric dynamical system: its energy counts as zero and it certifies nothing.
    """

    form: NaturalForm
    name = "held"
    certified = False

    def __call__(self, x, xd):
        return self.form

    def energy(self, x, xd):
        return jax.numpy.zeros((), x.dtype)

    def dissipation(self, x, xd):
        return jax.numpy.zeros((), x.dtype)

    def leaves(self):
        yield self  # type: ignore[misc]


def learned_forms(tree: Node, q: jax.Array, qd: jax.Array) -> tuple[NaturalForm, ...]:
    """The natural forms `[f, M]` of a tree's learned leaves, each in its own task space, at one state.

    Learned leaves are the terms of the tree that are pullbacks of `Learned` leaves alone.
    """
    forms = []
    for node in _terms(tree):
        if _is_learned(node):
            there = pushforward(node.task_map, q, qd)
            forms.append(node.node(there.y, there.yd))
    return tuple(forms)


def with_held(tree: Node, forms: tuple[NaturalForm, ...]) -> Node:
    """The same tree with its learned leaves replaced by what `learned_forms` gave; task maps and the rest are live.

    So the held force and metric act in task space through the present Jacobian: `f = J^T (f_held - M_held Jdot qd)`.
    """
    left = list(forms)
    return Sum(tuple(Pullback(n.task_map, Held(left.pop(0))) if _is_learned(n) else n for n in _terms(tree)))


def _terms(tree: Node) -> tuple[Any, ...]:
    return tree.nodes if isinstance(tree, Sum) else (tree,)


def _is_learned(node: Node) -> bool:
    return isinstance(node, Pullback) and all(isinstance(leaf, Learned) for leaf in node.leaves())
