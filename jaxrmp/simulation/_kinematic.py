"""Kinematic simulation: joints that do exactly what the policy asks."""

import contextlib
import warnings
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import ConfigurationError, RolloutError, ShapeError
from .._forms import Method
from .._pytree import as_pytree
from .._tree import Node
from ..inspection import goals
from ._arrival import warn_if_out_of_reach
from ._rollout import Rollout
from ._stable_step import StiffnessWarning, states_before_divergence, warn_if_stiff
from ._step import Motion, command, euler


def rollout(
    tree: Node,
    q: jax.Array,
    qd: jax.Array | None = None,
    *,
    duration: float = 20.0,
    dt: float = 0.005,
    substeps: int = 1,
    method: Method = "cholesky",
    warn: bool = True,
) -> Rollout:
    """Roll a policy out from one state by semi-implicit Euler: `qd += dt qdd; q += dt qd`, summed with what rounding
    cuts off, so that slow joints move in single precision too.

    **Arguments**: `tree`, a node on joint space; `q` [n], rad or m; `qd` [n], per second, default rest; `duration` and
    `dt`, seconds; `substeps`, policy evaluations per recorded step of `dt`; `method`, see `resolve`; `warn`, whether a
    call with numbers checks what it has done: it issues a `StiffnessWarning` that gives the stable step if `dt` is too
    long for the policy, at the start or at states on the way (`warn_if_stiff`, which compiles the policy once more),
    and a `GoalWarning` if the arm came to rest away from a goal. Under `jit`, `vmap` and `grad` there are no numbers to
    check: `gap` is in the result, `arrival(path)` judges it, and `warn_if_stiff` checks a step beforehand.
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

    tree = jax.tree.map(lambda part: as_pytree(part) if callable(part) else part, tree)
    path = _rolled(tree, q, qd, h, dt, round(duration / dt) + 1, substeps, method)
    if warn and not isinstance(path.q, Tracer):
        _check(tree, path, h, method)
    return path


@partial(jax.jit, static_argnames=("steps", "substeps", "method"))  # so that numbers alone do not compile again
def _rolled(tree, q, qd, h, dt, steps, substeps, method) -> Rollout:
    # For gradients, a step is computed again rather than kept: a fortieth of the memory, and faster (on a CPU).
    @partial(jax.checkpoint, prevent_cse=False)
    def advance(state, _):
        asked = command(tree, state.q, state.qd, method)
        return euler(state, asked.qdd, h), asked.energy

    def record(state, _):
        ahead, energies = jax.lax.scan(advance, state, length=substeps)
        return ahead, (state.q, state.qd, energies[0], goals(tree, state.q))

    _, (q_all, qd_all, energy, left) = jax.lax.scan(record, Motion(q, jnp.zeros_like(q), qd), length=steps)
    return Rollout(dt * jnp.arange(steps, dtype=q.dtype), q_all, qd_all, energy, left.gap, left.names)


def _check(tree: Node, path: Rollout, h: float, method: Method) -> None:
    q, qd = np.asarray(path.q), np.asarray(path.qd)
    finite = np.isfinite(q).all(1) & np.isfinite(qd).all(1)
    end = len(q) if finite.all() else max(int(finite.argmin()), 1)
    if not finite.all():
        warnings.warn(
            f"the rollout is not finite from {float(path.time[finite.argmin()]):.3g} s on: the policy or the start "
            f"holds numbers that are not, or steps of {h:.3g} s are too long.",
            StiffnessWarning,
            stacklevel=3,
        )
    with contextlib.suppress(RolloutError):  # of a start that is no number, which the states show
        chosen = states_before_divergence(tree, q[:end], qd[:end], h, method)
        warn_if_stiff(tree, path.q[chosen], path.qd[chosen], h, method, stacklevel=4)
    warn_if_out_of_reach(path, stacklevel=4)
