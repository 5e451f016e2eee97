"""What every simulation does in a step: the policy's call, and the joints moved by what it asks for."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from .._forms import Method, resolve
from .._tree import Node
from ..xla import in_lanes


class Command(NamedTuple):
    """What a policy gives at a state: its `energy` V, and the accelerations `qdd` [n] that it asks for."""

    energy: jax.Array
    qdd: jax.Array


@in_lanes
def command(tree: Node, q: jax.Array, qd: jax.Array, method: Method = "cholesky") -> Command:
    """Energy and accelerations of a policy at one state `q`, `qd` [n], in one pass over the tree."""
    found = tree.measure(q, qd)
    return Command(found.energy, resolve(found.form.dense(), method))


class Motion(NamedTuple):
    """A state of the joints: `q` and `rest` [n], what rounding cut off it, and `qd` [n]."""

    q: jax.Array
    rest: jax.Array
    qd: jax.Array

    @classmethod
    def at_rest(cls, q: Any) -> "Motion":
        """Standing still at `q` [n], in single precision."""
        q = jnp.asarray(q, jnp.float32)
        return cls(q, jnp.zeros_like(q), jnp.zeros_like(q))


def euler(state: Motion, qdd: jax.Array, dt: jax.Array | float) -> Motion:
    """A step of semi-implicit Euler, `qd += dt qdd; q += dt qd`, from `state`; `qdd` [n], `dt` in s.

    Positions are summed with what rounding cuts off (Kahan): in single precision a joint slower than 6e-5 rad/s would
    not move at all in steps of a millisecond.
    """
    q, rest, qd = state
    qd = qd + dt * qdd
    moved = dt * qd + rest
    further = q + moved
    return Motion(further, moved - (further - q), qd)
