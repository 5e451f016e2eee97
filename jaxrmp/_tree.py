"""The tree: policies as nodes, composed by sums and pullbacks.

A node is a callable pytree `(x, xd) -> NaturalForm`. `pullback(task_map, node)` is a node on the map's domain, a sum
of nodes is a node, and a leaf is a node that no other node makes up. What the node computes for forces it computes
for energy and dissipation too, so a whole tree carries its own Lyapunov function.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from ._errors import LeafError, ShapeError
from ._forms import Form, Method, NaturalForm, resolve
from ._linalg import length
from ._pytree import as_pytree, pytree, set_field, static
from ._task_map import Selection
from ._visitor import Leaves, Measured, Measurement, Visitor
from .xla import in_lanes


class Node:
    """A policy on a space: position and velocity in, natural form out.

    A kind of node implements `accept`, in terms of the `Visitor`'s methods; all else follows from it.
    """

    def accept(self, visitor: Visitor, state: Any) -> Any:
        """What `visitor` finds here, given the `state` that it carries down to here."""
        raise NotImplementedError(f"{type(self).__name__} is a kind of node of its own and must implement accept.")

    def __call__(self, x: jax.Array, xd: jax.Array) -> NaturalForm:
        return self.evaluate(x, xd).dense()

    def evaluate(self, x: jax.Array, xd: jax.Array) -> Form:
        """What the call gives at `x, xd`, with the structure of its metric kept: what task maps pull back."""
        return self.accept(Measurement(form=True), (x, xd)).form

    def energy(self, x: jax.Array, xd: jax.Array) -> jax.Array:
        """Lyapunov function `V = 1/2 xd^T G xd + Phi` at `x, xd`, a scalar; zero from a leaf that has none."""
        return self.accept(Measurement(energy=True), (x, xd)).energy

    def dissipation(self, x: jax.Array, xd: jax.Array) -> jax.Array:
        """Rate of energy loss `xd^T B xd` at `x, xd`, a scalar, per second; zero from a leaf that has none."""
        return self.accept(Measurement(dissipation=True), (x, xd)).dissipation

    def measure(self, x: jax.Array, xd: jax.Array) -> Measured:
        """Form, energy and dissipation at `x, xd` together, every task map evaluated once."""
        return self.accept(Measurement(form=True, energy=True, dissipation=True), (x, xd))

    def leaves(self) -> "tuple[Leaf, ...]":
        """The leaves below this node, in order."""
        return self.accept(Leaves(), None)

    def __add__(self, other: "Node") -> "Sum":
        if not isinstance(other, Node):
            return NotImplemented
        return Sum((*_terms(self), *_terms(other)))


class Leaf(Node):
    """A node at the end of a branch. `name` is what reports call it, `certified` says whether it is a geometric
    dynamical system, `has_goal` whether it is there to bring its space to one place, so that what is left to it
    (`gap`) tells success from failure.

    A leaf that is not keeps the energies of the others but voids their sum as a certificate: it inherits the zero
    energy below and sets `certified = False`.

    Subclasses implement `__call__`; those of `SeparableLeaf`, `evaluate`. **Raises** `LeafError`, when the class is
    made, for the other alone: a tree, or a call, would pass over it.
    """

    name: str = "leaf"
    certified = True
    has_goal = False
    _place = ""  # the field, if any, that says what the leaf is about
    _written, _derived = "__call__", "evaluate"

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        if cls._derived in vars(cls) and cls._written not in vars(cls):
            raise LeafError(
                f"{cls.__name__} overrides {cls._derived} alone, which follows from {cls._written}: override "
                f"{cls._written}."
            )

    def accept(self, visitor, state):
        return visitor.visit_leaf(self, state)

    def __call__(self, x, xd):
        raise NotImplementedError

    def evaluate(self, x, xd):
        return self(x, xd)

    def energy(self, x, xd):
        return jnp.zeros((), x.dtype)

    def dissipation(self, x, xd):
        return jnp.zeros((), x.dtype)

    def measure(self, x, xd):
        return Measured(self.evaluate(x, xd), self.energy(x, xd), self.dissipation(x, xd))

    def gap(self, x: jax.Array) -> jax.Array:
        """How far `x` [n] is from what the leaf is about, a scalar in units of x: the distance left to its goal, or
        the least distance that it keeps. NaN if it is about no place, as damping is; if it has a goal and does not say
        where, `|x|`."""
        if self._place:
            x = x - jnp.asarray(getattr(self, self._place), x.dtype)
        return length(x.reshape(-1)) if self.has_goal or self._place else jnp.full((), jnp.nan, x.dtype)


class SeparableLeaf(Leaf):
    """A leaf of one-dimensional policies side by side. Subclasses implement `evaluate`, and return a `DiagonalForm`."""

    _written, _derived = "evaluate", "__call__"

    def __call__(self, x, xd):
        return self.evaluate(x, xd).dense()

    def evaluate(self, x: jax.Array, xd: jax.Array) -> Form:
        raise NotImplementedError


@pytree
class Sum(Node):
    """Policies on the same space, `nodes`, acting together: forces and metrics add."""

    nodes: tuple[Node, ...]

    def accept(self, visitor, state):
        return visitor.visit_sum(self.nodes, state)


@pytree
class Pullback(Node):
    """A policy on another space, `node`, seen from this one through `task_map`."""

    task_map: Callable[[jax.Array], jax.Array]
    node: Node

    def __post_init__(self):
        set_field(self, "task_map", as_pytree(self.task_map))

    def accept(self, visitor, state):
        return visitor.visit_pullback(self.task_map, self.node, state)


@pytree
class Batched(Node):
    """One policy at K points [K, m] at once, evaluated as one batch.

    The parameters of `node` carry a leading axis of K, one policy a point, unless `shared`, when every point has the
    same. Much faster to run and to compile than K nodes in a sum.

    **Raises** `ShapeError` if the parameters do not all have that leading axis.
    """

    node: Node
    shared: bool = static(default=False)

    def __post_init__(self):
        sizes = {jnp.shape(leaf)[:1] for leaf in jax.tree.leaves(self.node)}
        if not self.shared and (len(sizes) > 1 or () in sizes):
            raise ShapeError(
                f"parameters of a batched node need one common leading axis, received leading axes {sorted(sizes)}. "
                "Stack them with batched(node, node, ...), or say shared=True if all points have the same parameters."
            )

    def accept(self, visitor, state):
        return visitor.visit_batched(self.node, self.shared, state)


@pytree
class Scaled(Node):
    """A `node` of which a `share` counts: force, metric, energy and dissipation alike; with 0, it is switched off.

    A scaled geometric dynamical system is one too, so the certificate holds for every share that stays as it is.

    >>> from jaxrmp.leaves import Damping
    >>> Scaled(Damping(weight=2.0), 0.5)(jnp.zeros(1), jnp.ones(1)).M.tolist()
    [[1.0]]
    """

    node: Node
    share: jax.Array | float

    def accept(self, visitor, state):
        return visitor.visit_scaled(self.node, self.share, state)


def pullback(task_map: Callable[[jax.Array], jax.Array], node: Node) -> Pullback:
    """See a policy on `y = psi(x)` as a policy on x: `f = J^T (f_y - M_y Jdot xd)`, `M = J^T M_y J`.

    **Arguments**: `task_map`, a `TaskMap` or any differentiable function (a new function compiles anew: what is to move
    without that goes into a `TaskMap`'s fields, or into `jax.tree_util.Partial`); `node`, a policy on its range.
    **Returns** a node on the map's domain; energy and dissipation are pulled back with it.

    >>> import jax.numpy as jnp
    >>> from jaxrmp import Distance
    >>> from jaxrmp.leaves import CollisionAvoidance
    >>> keep_off = pullback(Distance(jnp.array([0.5, 0.0]), 0.1), CollisionAvoidance())
    >>> keep_off(jnp.zeros(2), jnp.array([1.0, 0.0])).M.shape
    (2, 2)

    **Raises** `TypeError` for a policy in the map's place.

    Rana et al. 2019, equation 9.
    """
    if isinstance(task_map, Node):
        raise TypeError(f"pullback(task_map, node): {type(task_map).__name__} is a policy, not a map. Swap the two?")
    return Pullback(task_map, node)


def on_coordinates(indices: tuple[int, ...], size: int, node: Node) -> Node:
    """A node on some coordinates of a vector [size]: without a map where they are all in order, nothing for none."""
    if indices == tuple(range(size)):
        return node
    return pullback(Selection(indices), node) if indices else Sum(())


def batched(*nodes: Node) -> Batched:
    """`*nodes` of the same kind at K points [K, m], stacked into one `Batched` node.

    **Raises** `ShapeError` for nodes that are not alike in all but the values of their parameters.

    >>> from jaxrmp.leaves import Posture
    >>> batched(Posture(jnp.zeros(2)), Posture(jnp.ones(2)))(jnp.zeros((2, 2)), jnp.zeros((2, 2))).M.shape
    (2, 2, 2)
    """
    if not nodes:
        raise ShapeError("batched() needs at least one node.")
    for i, node in enumerate(nodes):
        if jax.tree.structure(node) != jax.tree.structure(nodes[0]):
            raise ShapeError(
                f"node {i} has another kind or other static fields (its name, for one) than node 0: "
                f"{jax.tree.structure(node)} and {jax.tree.structure(nodes[0])}. Only like nodes make "
                "one batch; add others with +."
            )
    return Batched(jax.tree.map(lambda *parameters: jnp.stack([jnp.asarray(p) for p in parameters]), *nodes))


@in_lanes
def acceleration(tree: Node, q: jax.Array, qd: jax.Array, method: Method = "cholesky") -> jax.Array:
    """The joint acceleration of a whole tree: `qdd = M^+ f` at the root.

    **Arguments**: `tree`, a node on joint space; `q` [n], rad or m; `qd` [n], per second; `method`, see `resolve`.
    **Returns** `qdd` [n]. Compile it once with `jax.jit(acceleration)`: the tree is an argument, so changing a goal
    or a gain does not compile again.

    >>> import jax.numpy as jnp
    >>> from jaxrmp.leaves import Damping, Posture
    >>> tree = Posture(jnp.zeros(2)) + Damping(weight=1.0, damping_rate=2.0)
    >>> acceleration(tree, jnp.zeros(2), jnp.ones(2)).shape
    (2,)

    RMPflow (Cheng et al. 2018), section 3.2.
    """
    return resolve(tree(q, qd), method)


def _terms(node: Node) -> tuple[Node, ...]:
    return node.nodes if isinstance(node, Sum) else (node,)
