"""How long a step of explicit integration may be before the policy rings or blows up."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import RolloutError
from .._forms import Method
from .._tree import Node, acceleration


class StiffnessWarning(UserWarning):
    """A policy is too stiff for the step it is integrated with."""


def stable_step(tree: Node, q: jax.Array, qd: jax.Array, method: Method = "cholesky") -> float:
    """An estimate of the longest stable step of semi-implicit Euler near one state, in seconds.

    Of the linearised policy, `k` is the fastest damping rate, the largest real part among the eigenvalues of
    `-d qdd/d qd`, and `w` likewise the largest stiffness of `-d qdd/d q`; `qd += h qdd; q += h qd` is stable for
    `2 k h + w h^2 < 4`: `h = 4 / (k + sqrt(k^2 + 4 w))`. That is `2 / k` for damping alone and `2 / sqrt(w)` for
    springs alone. From half of it on, the velocity already changes sign from step to step (`k h > 1`).

    It is exact for one coordinate and an estimate for more, from the worst of both rates; it says nothing about states
    elsewhere, such as nearer to an obstacle. Not for use under `jax.jit`: eigenvalues are taken on the host. Every call
    compiles, which for an arm takes up to half a minute: for one check before a long rollout, not for a loop.

    **Arguments**: `tree`, a node on joint space; `q` [n], rad or m; `qd` [n], per second; `method`, see `resolve`.
    **Returns** seconds, infinite if nothing there damps or pulls.
    **Raises** `RolloutError` if the policy's derivatives are not finite there.
    """
    k, w = _rates(tree, q, qd, method)
    return _step(k, w)


def warn_if_stiff(tree: Node, q: jax.Array, qd: jax.Array, dt: float, method: Method = "cholesky") -> float:
    """Warn if explicit integration by steps of `dt` seconds rings or blows up near a state; arguments as `stable_step`.

    Issues a `StiffnessWarning` that gives the stable step where `dt` is above half of it: there damping
    overshoots zero velocity at every step (`k dt > 1`), and limit cycles start.
    **Returns** the stable step, seconds.
    """
    k, w = _rates(tree, q, qd, method)
    longest = _step(k, w)
    if dt > longest / 2:
        what = "is unstable" if dt > longest else "may ring"
        warnings.warn(
            f"explicit integration with dt = {dt:.3g} s {what}: damping rate times step is {k * dt:.3g}, stiffness "
            f"times step squared {w * dt * dt:.3g}. The longest stable step here is {longest:.3g} s, and half "
            f"of it does not ring: use rollout(..., substeps={int(np.ceil(2 * dt / longest))}) or a smaller dt.",
            StiffnessWarning,
            stacklevel=2,
        )
    return longest


def _rates(tree: Node, q: jax.Array, qd: jax.Array, method: Method) -> tuple[float, float]:
    """Fastest damping rate, 1/s, and largest stiffness, 1/s^2, of the linearised policy; not below zero."""
    q, qd = jnp.asarray(q), jnp.asarray(qd)
    # Compiled, since an arm's kinematics are slower still operation by operation. The tree is closed over: it may hold
    # plain functions, which cannot be arguments of a compiled function.
    slopes = jax.jit(jax.jacfwd(lambda q, qd: acceleration(tree, q, qd, method), argnums=(1, 0)))(q, qd)
    D, K = (-np.asarray(slope, float) for slope in slopes)
    if not (np.isfinite(D).all() and np.isfinite(K).all()):
        raise RolloutError(
            f"the policy's derivatives are not finite at q = {np.asarray(q).tolist()}, qd = {np.asarray(qd).tolist()}."
        )
    k, w = (max(float(np.linalg.eigvals(A).real.max()), 0.0) for A in (D, K))
    return k, w


def _step(k: float, w: float) -> float:
    rate = k + np.sqrt(k * k + 4 * w)
    return float(4 / rate) if rate > 0 else float("inf")
