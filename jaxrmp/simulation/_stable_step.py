"""How long a step of explicit integration may be before the policy rings or blows up."""

import warnings
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import RolloutError
from .._forms import Method
from .._tree import Node, acceleration


class StiffnessWarning(UserWarning):
    """A policy is too stiff for the step it is integrated with."""


def stable_step(tree: Node, q: jax.Array, qd: jax.Array, method: Method = "cholesky") -> float:
    """An estimate of the longest stable step of semi-implicit Euler near one state or several, in seconds.

    Of the linearised policy, `k` is the fastest damping rate, the largest real part among the eigenvalues of
    `-d qdd/d qd`, and `w` likewise the largest stiffness of `-d qdd/d q`; `qd += h qdd; q += h qd` is stable for
    `2 k h + w h^2 < 4`: `h = 4 / (k + sqrt(k^2 + 4 w))`. That is `2 / k` for damping alone and `2 / sqrt(w)` for
    springs alone. From half of it on, the velocity already changes sign from step to step (`k h > 1`).

    It is exact for one coordinate and an estimate for more, from the worst of both rates; it says nothing about states
    elsewhere, such as nearer to an obstacle. Not for use under `jax.jit`: eigenvalues are taken on the host. The slopes
    are central differences of the acceleration, by a program that is compiled once for all trees of one structure, in
    about the time the policy itself takes.

    **Arguments**: `tree`, a node on joint space; `q` [n], rad or m, and `qd` [n], per second, or [S, n] both, S states,
    of which the stiffest counts, those without finite derivatives left out; `method`, see `resolve`.
    **Returns** seconds, infinite if nothing there damps or pulls.
    **Raises** `RolloutError` if the policy has finite derivatives at none of the states.

    >>> from jaxrmp.leaves import Damping
    >>> round(stable_step(Damping(weight=1.0, damping_rate=20.0), jnp.zeros(2), jnp.ones(2)), 4)
    0.1
    """
    return float(_step(*_worst(tree, q, qd, method)))


def warn_if_stiff(
    tree: Node, q: jax.Array, qd: jax.Array, dt: float, method: Method = "cholesky", stacklevel: int = 2
) -> float:
    """Warn if explicit integration by steps of `dt` seconds rings or blows up near a state; arguments as `stable_step`.

    Issues a `StiffnessWarning` that gives the stable step where `dt` is above half of it: there damping
    overshoots zero velocity at every step (`k dt > 1`), and limit cycles start. `stacklevel` is `warnings.warn`'s.
    **Returns** the stable step, seconds.
    """
    k, w = _worst(tree, q, qd, method)
    longest = float(_step(k, w))
    if dt > longest / 2:
        what = "is unstable" if dt > longest else "may ring"
        warnings.warn(
            f"explicit integration with dt = {dt:.3g} s {what}: damping rate times step is {k * dt:.3g}, stiffness "
            f"times step squared {w * dt * dt:.3g}. The longest stable step here is {longest:.3g} s, and half "
            f"of it does not ring: divide the step by {int(np.ceil(2 * dt / longest))}, by substeps of rollout or a "
            "smaller dt.",
            StiffnessWarning,
            stacklevel=stacklevel,
        )
    return longest


def states_before_divergence(
    tree: Node, q: np.ndarray, qd: np.ndarray, dt: float, method: Method, count: int = 8
) -> np.ndarray:
    """Indices of up to `count` states of a rollout that tell how long its steps may be.

    Once steps are too long, what follows says nothing about the policy: rates of absurd states are absurd. So the first
    state where steps of `dt` are unstable is looked for, by ever finer parts of the path, and no state counts that
    comes after the speed has doubled from there.

    **Arguments**: `q`, `qd` [T, n], a rollout's; `dt`, seconds, of its steps; `method`, see `resolve`.
    """
    first, last = 0, len(q) - 1
    while True:
        chosen = np.linspace(first, last, count).round().astype(int)
        k, w = _rates(tree, q[chosen], qd[chosen], method)
        unstable = ~(dt <= _step(k, w))  # where rates are no numbers, too
        if not unstable.any():
            return chosen
        at = int(unstable.argmax())
        if at == 0 or chosen[at] - chosen[at - 1] <= 1:
            break
        first, last = chosen[at - 1], chosen[at]
    sane, speed = int(chosen[at]), np.linalg.norm(np.asarray(qd, float), axis=1)
    fast = np.flatnonzero(speed[sane:] > 2 * speed[: sane + 1].max())
    end = sane + int(fast[0]) - 1 if fast.size else len(q) - 1
    return np.linspace(sane, max(end, sane), count).round().astype(int)


def _worst(tree: Node, q: jax.Array, qd: jax.Array, method: Method) -> tuple[float, float]:
    """Of the state with the shortest stable step: fastest damping rate, 1/s, and largest stiffness, 1/s^2."""
    k, w = _rates(tree, q, qd, method)
    if np.isnan(k).all():
        at = (np.atleast_2d(np.asarray(part))[0].tolist() for part in (q, qd))
        raise RolloutError("the policy's derivatives are not finite at q = {}, qd = {}.".format(*at))
    worst = int(np.nanargmin(_step(k, w)))
    return float(k[worst]), float(w[worst])


def _rates(tree: Node, q, qd, method: Method) -> tuple[np.ndarray, np.ndarray]:
    """Fastest damping rate and largest stiffness at each state [S], NaN where derivatives are not finite."""
    states = [jnp.atleast_2d(jnp.asarray(part, jnp.result_type(part, float))) for part in (q, qd)]
    if all(isinstance(leaf, jax.Array | np.ndarray | np.generic | float | int) for leaf in jax.tree.leaves(tree)):
        slopes = _slopes(tree, *states, method=method)
    else:  # plain functions cannot be arguments of a compiled function, and so this program serves one tree only
        slopes = jax.jit(lambda q, qd: _differences(tree, q, qd, method))(*states)
    D, K = (-np.asarray(slope, float) for slope in slopes)
    finite = (np.isfinite(D) & np.isfinite(K)).all((1, 2))
    rates = np.full((2, len(D)), np.nan)
    for row, A in zip(rates, (D, K), strict=True):
        row[finite] = np.linalg.eigvals(A[finite]).real.max(-1).clip(0)
    return rates[0], rates[1]


def _differences(tree: Node, q: jax.Array, qd: jax.Array, method: Method) -> tuple[jax.Array, jax.Array]:
    """`d qdd/d qd` and `d qdd/d q` [S, n, n] by central differences.

    Derivatives by autodiff would be exact, but take an arm three times as long to compile.
    """
    n, x = q.shape[1], jnp.concatenate([q, qd], axis=1)
    h = jnp.finfo(x.dtype).eps ** (1 / 3) * jnp.maximum(jnp.abs(x), 1)
    step = h[:, :, None] * jnp.eye(2 * n, dtype=x.dtype)
    around = jnp.stack([x[:, None] + step, x[:, None] - step], axis=2)  # [S, 2n, 2, 2n]
    qdd = jax.lax.map(lambda x: acceleration(tree, x[:n], x[n:], method), around.reshape(-1, 2 * n))
    ahead, behind = jnp.moveaxis(qdd.reshape(*around.shape[:3], n), 2, 0)
    slopes = jnp.swapaxes((ahead - behind) / (2 * h[:, :, None]), 1, 2)
    return slopes[..., n:], slopes[..., :n]


_slopes = partial(jax.jit, static_argnames="method")(_differences)


def _step(k, w):
    rate = np.asarray(k + (k * k + 4 * w) ** 0.5)
    return np.where(rate == 0, np.inf, 4 / np.where(rate == 0, 1, rate))
