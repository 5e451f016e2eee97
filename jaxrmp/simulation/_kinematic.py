"""Kinematic simulation: joints that do exactly what the policy asks."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from .._errors import ConfigurationError, ShapeError
from .._forms import Method
from .._tree import Node, acceleration


class Rollout(NamedTuple):
    """States along a rollout of T steps, the first being the start.

    `time` [T] s, `q` [T, n], `qd` [T, n] per second, `energy` [T], the tree's Lyapunov function.
    """

    time: jax.Array
    q: jax.Array
    qd: jax.Array
    energy: jax.Array


def rollout(
    tree: Node,
    q: jax.Array,
    qd: jax.Array | None = None,
    *,
    duration: float = 20.0,
    dt: float = 0.005,
    substeps: int = 1,
    method: Method = "cholesky",
) -> Rollout:
    """Roll a policy out from one state by semi-implicit Euler: `qd += dt qdd; q += dt qd`.

    **Arguments**: `tree`, a node on joint space; `q` [n], rad or m; `qd` [n], per second, default rest; `duration` and
    `dt`, seconds; `substeps`, policy evaluations per recorded step of `dt`.
    **Raises** `ConfigurationError` for times that make no sense, `ShapeError` for shapes that do not fit.
    **Returns** a `Rollout` with `T = round(duration / dt) + 1`. One compiled loop under `jax.jit`; `vmap` over starts.
    Gradients with respect to the tree's parameters go through it; they keep the states, not what made them.

    >>> from jaxrmp.leaves import Damping
    >>> path = rollout(Damping(weight=1.0, damping_rate=2.0), jnp.zeros(2), jnp.ones(2), duration=5.0)
    >>> path.q.shape, bool(path.energy[-1] < 1e-6)
    ((1001, 2), True)
    """
    if not (0 < dt <= duration < float("inf")) or substeps < 1:
        raise ConfigurationError(
            f"dt is {dt!r}, duration {duration!r} and substeps {substeps!r}: expected 0 < dt <= duration and "
            "substeps >= 1."
        )
    q = jnp.asarray(q, jnp.result_type(q, float))
    qd = jnp.zeros_like(q) if qd is None else jnp.asarray(qd, q.dtype)
    if q.shape != qd.shape or q.ndim != 1:
        raise ShapeError(f"q has shape {q.shape} and qd {qd.shape}, expected [n] for both. For many starts, vmap.")
    h = dt / substeps

    # For gradients, a step is computed again rather than kept: a fortieth of the memory, and faster (on a CPU).
    @partial(jax.checkpoint, prevent_cse=False)
    def advance(state, _):
        q, qd = state
        qd = qd + h * acceleration(tree, q, qd, method)
        return (q + h * qd, qd), None

    def record(state, _):
        return jax.lax.scan(advance, state, length=substeps)[0], (*state, tree.energy(*state))

    steps = round(duration / dt) + 1
    _, (q_all, qd_all, energy) = jax.lax.scan(record, (q, qd), length=steps)
    return Rollout(dt * jnp.arange(steps, dtype=q.dtype), q_all, qd_all, energy)
