"""The tree: policies as nodes, composed by sums and pullbacks.

A node is a callable pytree `(x, xd) -> NaturalForm`. `pullback(task_map, node)` is a node on the map's domain, a sum
of nodes is a node, and a leaf is a node that no other node makes up. What the node computes for forces it computes
for energy and dissipation too, so a whole tree carries its own Lyapunov function.
"""

from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp

from ._errors import LeafError, ShapeError
from ._forms import Form, Method, NaturalForm, resolve
from ._pytree import pytree, static
from ._task_map import transport


class Node:
    """A policy on a space: position and velocity in, natural form out."""

    def __call__(self, x: jax.Array, xd: jax.Array) -> NaturalForm:
        raise NotImplementedError

    def evaluate(self, x: jax.Array, xd: jax.Array) -> Form:
        """What the call gives at `x, xd`, with the structure of its metric kept: what task maps pull back."""
        return self(x, xd)

    def energy(self, x: jax.Array, xd: jax.Array) -> jax.Array:
        """Lyapunov function `V = 1/2 xd^T G xd + Phi` at `x, xd`, a scalar; zero from a leaf that has none."""
        raise NotImplementedError

    def dissipation(self, x: jax.Array, xd: jax.Array) -> jax.Array:
        """Rate of energy loss `xd^T B xd` at `x, xd`, a scalar, per second; zero from a leaf that has none."""
        raise NotImplementedError

    def leaves(self) -> Iterator["Leaf"]:
        """The leaves below this node, in order."""
        raise NotImplementedError

    def __add__(self, other: "Node") -> "Sum":
        if not isinstance(other, Node):
            return NotImplemented
        return Sum((*_terms(self), *_terms(other)))


class Leaf(Node):
    """A node at the end of a branch. `name` is what reports call it, `certified` says whether it is a geometric
    dynamical system, `has_goal` whether it is there to bring its space to one place, so that what is left to it
    (`inspection.gap`) tells success from failure.

    A leaf that is not keeps the energies of the others but voids their sum as a certificate: it inherits the zero
    energy below and sets `certified = False`.

    Subclasses implement `__call__`; those of `SeparableLeaf`, `evaluate`. **Raises** `LeafError`, when the class is
    made, for the other alone: a tree, or a call, would pass over it.
    """

    name: str
    certified = True
    has_goal = False
    _written, _derived = "__call__", "evaluate"

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        if cls._derived in vars(cls) and cls._written not in vars(cls):
            raise LeafError(
                f"{cls.__name__} overrides {cls._derived} alone, which follows from {cls._written}: override "
                f"{cls._written}."
            )

    def energy(self, x, xd):
        return jnp.zeros((), x.dtype)

    def dissipation(self, x, xd):
        return jnp.zeros((), x.dtype)

    def leaves(self):
        yield self


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

    def __call__(self, x, xd):
        return self.evaluate(x, xd).dense()

    def evaluate(self, x, xd):
        total = self.nodes[0].evaluate(x, xd)
        for node in self.nodes[1:]:
            total = total + node.evaluate(x, xd)
        return total

    def energy(self, x, xd):
        return sum(node.energy(x, xd) for node in self.nodes)

    def dissipation(self, x, xd):
        return sum(node.dissipation(x, xd) for node in self.nodes)

    def leaves(self):
        for node in self.nodes:
            yield from node.leaves()


@pytree
class Pullback(Node):
    """A policy on another space, `node`, seen from this one through `task_map`."""

    task_map: Callable[[jax.Array], jax.Array]
    node: Node

    def __call__(self, x, xd):
        return self.evaluate(x, xd).dense()

    def evaluate(self, x, xd):
        y, yd, pull = transport(self.task_map, x, xd)
        return pull(self.node.evaluate(y, yd))

    def energy(self, x, xd):
        return self.node.energy(*jax.jvp(self.task_map, (x,), (xd,)))

    def dissipation(self, x, xd):
        return self.node.dissipation(*jax.jvp(self.task_map, (x,), (xd,)))

    def leaves(self):
        yield from self.node.leaves()


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

    def __call__(self, x, xd):
        return self.evaluate(x, xd).dense()

    def evaluate(self, x, xd):
        return self._over_points(lambda node, x, xd: node.evaluate(x, xd), x, xd)

    def energy(self, x, xd):
        return jnp.sum(self._over_points(lambda node, x, xd: node.energy(x, xd), x, xd))

    def dissipation(self, x, xd):
        return jnp.sum(self._over_points(lambda node, x, xd: node.dissipation(x, xd), x, xd))

    def leaves(self):
        yield from self.node.leaves()

    def _over_points(self, evaluate, x, xd):
        K = None if self.shared else jnp.shape(jax.tree.leaves(self.node)[0])[0]
        if x.ndim < 2 or K not in (None, x.shape[0]):
            raise ShapeError(f"x has shape {x.shape}, expected [{K or 'K'}, m]: a batched node acts on points.")
        return jax.vmap(evaluate, in_axes=(None if self.shared else 0, 0, 0))(self.node, x, xd)


def pullback(task_map: Callable[[jax.Array], jax.Array], node: Node) -> Pullback:
    """See a policy on `y = psi(x)` as a policy on x: `f = J^T (f_y - M_y Jdot xd)`, `M = J^T M_y J`.

    **Arguments**: `task_map`, a `TaskMap` or any differentiable function; `node`, a policy on its range.
    **Returns** a node on the map's domain; energy and dissipation are pulled back with it.

    >>> import jax.numpy as jnp
    >>> from jaxrmp import Distance
    >>> from jaxrmp.leaves import CollisionAvoidance
    >>> keep_off = pullback(Distance(jnp.array([0.5, 0.0]), 0.1), CollisionAvoidance())
    >>> keep_off(jnp.zeros(2), jnp.array([1.0, 0.0])).M.shape
    (2, 2)

    Rana et al. 2019, equation 9.
    """
    return Pullback(task_map, node)


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
