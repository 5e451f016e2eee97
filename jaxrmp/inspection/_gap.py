"""How far a leaf is from what it is about, as one number."""

import jax
import jax.numpy as jnp

from .._linalg import length
from .._tree import Node


def gap(leaf: Node, x: jax.Array) -> jax.Array:
    """How far a leaf is from what it is about: the distance left to its goal, or the least distance it keeps.

    The leaf's own method `leaf.gap(x) -> scalar` where it has one; a leaf that keeps distances x [m] returns `x.min()`.
    Without it: the least distance to a limit, for a leaf with fields `lower` and `upper` of the shape of x, negative
    beyond the limit; `|x - goal|` for one with such a field `goal`, `target` or `rest`; else `|x|`, the distance to the
    origin. At the goal itself the gradient is zero.

    **Arguments**: `leaf`, any node at the end of a branch; `x`, its task position, of any shape.
    **Returns** a scalar, units of x.

    >>> from jaxrmp.leaves import Attractor
    >>> float(gap(Attractor(goal=jnp.array([3.0, 4.0])), jnp.zeros(2)))
    5.0
    """
    own = getattr(leaf, "gap", None)
    if callable(own):
        return jnp.asarray(own(x), x.dtype)
    fields = {name: getattr(leaf, name, None) for name in ("lower", "upper", "goal", "target", "rest")}
    given = {name: jnp.asarray(v, x.dtype) for name, v in fields.items() if v is not None and jnp.shape(v) == x.shape}
    if "lower" in given and "upper" in given:
        return jnp.minimum(x - given["lower"], given["upper"] - x).min()
    for name in ("goal", "target", "rest"):
        if name in given:
            return length((x - given[name]).reshape(-1))
    return length(x.reshape(-1))
