"""Stability as mathematics: metrics, the goal's Hessian, every stationary point, and the certificate on the way."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._certificate import certificate, uncertified_leaves
from .._errors import ConfigurationError
from .._linalg import cholesky_solve, matmul
from ..kinematics import Robot
from ..learning import Skill
from ..learning._basin import cluster
from ..learning._flow_training import stretches
from ..leaves import Learned
from ..simulation import Problem

_STEPS = 300  # of the search for stationary points
_TOGETHER = 0.005  # m, within which two stationary points are one


def learned_metrics(learned: Learned, points: np.ndarray) -> list[dict[str, float]]:
    """Eigenvalues of each subtask's learned metric over a region.

    **Arguments**: `learned`, the leaves of K subtasks, stacked; `points` [N, K, 3], where they are evaluated, targets
    at zero, m. **Returns** for each subtask the least and the largest eigenvalue, and the share of points at which all
    are positive.
    """
    eigenvalues = np.linalg.eigvalsh(np.asarray(_metrics(learned, jnp.asarray(points, jnp.float32)), float))
    return [_spectrum(e) for e in np.moveaxis(eigenvalues, 1, 0)]


def _spectrum(eigenvalues: np.ndarray) -> dict[str, float]:
    """What a report says of a metric's eigenvalues [N, m] at N points."""
    return {
        "least_eigenvalue": float(eigenvalues.min()),
        "largest_eigenvalue": float(eigenvalues.max()),
        "positive_definite_share": float((eigenvalues > 0).all(axis=1).mean()),
        "points": len(eigenvalues),
    }


def flow_metrics(skill: Skill, robot: Robot, q: np.ndarray) -> dict[str, Any]:
    """As `learned_metrics` and `goal_hessians` have them, of the hand of a `skill` learned by a flow.

    The metric is `w J^T J`, with J of the flow, at the places of the hand in configurations `q` [N, n] of the `robot`;
    of a turn alone those up to 130 degrees from the goal, beyond which the flow fades out, or the goal, if none is. At
    the goal the potential is at least in all directions, whatever the flow is.
    """
    motion = skill.flow
    if motion is None:
        raise ConfigurationError("the skill was not learned by a flow.")
    places = motion.task_map(robot, skill.frames, skill.T_world_object, None)
    x = np.asarray(jax.jit(jax.vmap(places))(jnp.asarray(q, jnp.float32)))
    if motion.of_turn:
        beyond = motion.beyond(robot, skill.frames, skill.T_world_object)
        near = np.asarray(jax.jit(jax.vmap(beyond))(jnp.asarray(q, jnp.float32)))[:, 0] == 0
        x = x[near] if near.any() else np.zeros_like(x[:1])
    eigenvalues = float(motion.attractor.weight) * stretches(motion.flow, x) ** 2
    goal = stretches(motion.flow, np.zeros_like(x[:1]))[0] ** 2 * float(motion.attractor.speed)
    return {
        "metric": _spectrum(eigenvalues),
        "goal": {
            "slope": float(np.linalg.norm(motion.flow(jnp.zeros(x.shape[1], x.dtype)))),
            "hessian_eigenvalues": np.sort(goal / float(motion.attractor.taper)).tolist(),
        },
    }


def goal_hessians(learned: Learned) -> list[dict[str, Any]]:
    """Of each subtask in `learned`, stacked, the potential's slope and its Hessian's eigenvalues, 1/m, at the goal."""
    slopes, hessians = (np.asarray(a, float) for a in _derivatives(learned.potential_of, learned.speed))
    return [
        {"slope": float(np.linalg.norm(g)), "hessian_eigenvalues": np.linalg.eigvalsh(H).tolist()}
        for g, H in zip(slopes, hessians, strict=True)
    ]


def stationary_points(
    potential: Callable[[jax.Array], jax.Array],
    lower: np.ndarray,
    upper: np.ndarray,
    *,
    starts: int = 512,
    seed: int = 0,
) -> list[dict[str, Any]]:
    """Every stationary point of a potential in a box that a search from many starts finds, nearest to the goal first.

    Levenberg and Marquardt's method on `grad Phi = 0`, which ends at minima, saddles and maxima alike.

    **Arguments**: `potential`, a callable pytree of x [m], m, its goal at the origin; `lower`, `upper` [m], m, the box;
    `starts`, of the search, how many; `seed`, of their places.
    **Returns** for each `position`, its `kind` (minimum, saddle, maximum), its distance from the goal, the Hessian's
    `eigenvalues`, and the share of starts that ended there.
    """
    x = np.random.default_rng(seed).uniform(lower, upper, (starts, len(lower))).astype(np.float32)
    x, slope, hessian = (np.asarray(a, float) for a in _search(potential, jnp.asarray(x)))
    inside = ((x >= np.asarray(lower) - _TOGETHER) & (x <= np.asarray(upper) + _TOGETHER)).all(1)
    found = np.flatnonzero(inside & (np.linalg.norm(slope, axis=-1) < 1e-3))
    points = []
    for group in cluster(x[found], _TOGETHER):
        members = found[group]
        best = members[np.argmin(np.linalg.norm(slope[members], axis=-1))]
        eigenvalues = np.linalg.eigvalsh(hessian[best])
        kind = "minimum" if eigenvalues[0] > 0 else "maximum" if eigenvalues[-1] < 0 else "saddle"
        points.append(
            {
                "position": x[best].tolist(),
                "distance_m": float(np.linalg.norm(x[best])),
                "kind": kind,
                "eigenvalues": eigenvalues.tolist(),
                "share": len(members) / starts,
            }
        )
    return sorted(points, key=lambda point: point["distance_m"])


class CertificateWatch:
    """Evaluates the certificate of the tree along rollouts, once a chunk, and keeps the worst of each start.

    `residual` [N], the largest `|dV/dt + dissipation| / (1 + |V|)`, per second, zero but for rounding where every leaf
    is certified; `growth` [N], the largest `dV/dt / (1 + |V|)`, at most rounding. Both are NaN from where one was.
    """

    def __init__(self, problem: Problem, starts: int):
        self.problem = problem
        self.residual = np.zeros(starts, np.float32)
        self.growth = np.full(starts, -np.inf, np.float32)
        self.uncertified = uncertified_leaves(problem.tree)

    def __call__(self, places: np.ndarray, state: Any) -> None:
        """Look at the states of a batch; `places` [B], the starts that they belong to, -1 for none."""
        residual, growth = (np.asarray(a) for a in _certificates(self.problem.tree, state.q, state.qd))
        held = places >= 0
        for worst, now in ((self.residual, residual), (self.growth, growth)):
            worst[places[held]] = np.maximum(worst[places[held]], now[held])


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0))
def _certificates(tree, q, qd):
    found = certificate(tree, q, qd)
    return found.residual, found.dV_dt / (1 + jnp.abs(found.energy))


_metrics = jax.jit(jax.vmap(jax.vmap(lambda leaf, x: leaf.metric(x, x)), (None, 0)))


@jax.jit
def _derivatives(potentials, like):
    origin = jnp.zeros((jnp.shape(like)[0], 3))
    return jax.vmap(lambda potential, x: (jax.grad(potential)(x), jax.hessian(potential)(x)))(potentials, origin)


@jax.jit
def _search(potential, x):
    gradient, hessian = jax.grad(potential), jax.hessian(potential)

    def one(x):
        def step(carry, _):
            x, g, stiffness = carry
            H = hessian(x)
            normal = matmul(H.T, H) + stiffness * jnp.eye(x.shape[0], dtype=x.dtype)
            move = cholesky_solve(normal, matmul(H.T, g))
            length = jnp.sqrt(jnp.sum(move * move))
            ahead = x - move * jnp.minimum(1, 0.05 / jnp.maximum(length, 1e-12))
            g_ahead = gradient(ahead)
            better = matmul(g_ahead, g_ahead) < matmul(g, g)
            stiffness = jnp.clip(stiffness * jnp.where(better, 0.3, 4.0), 1e-8, 1e8)
            return (jnp.where(better, ahead, x), jnp.where(better, g_ahead, g), stiffness), None

        (x, g, _), _ = jax.lax.scan(step, (x, gradient(x), jnp.asarray(1.0, x.dtype)), length=_STEPS)
        return x, g, hessian(x)

    return jax.vmap(one)(x)
