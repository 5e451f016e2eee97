"""What kind of end each rollout came to."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._tree import Node
from ..simulation import End, Outcomes, Problem
from ..xla import in_blocks, in_lanes

_LEAST_FORCE = 1e-3  # N m (or N), what a limit must push with at least to be what holds the arm


class Ends(NamedTuple):
    """Of N rollouts: `kind` [N], an `End`; `points` [N, K, 3], the control points less their targets, m; `hand` [N, 3],
    the first of them in the world, m; `error` [N], the largest distance of one to its target, m; `limit_force` [N, n],
    of the joint limits, N m; `residual` [N], the largest entry of the force that is left there, N m; `margin` [N, n],
    the joints' distance to their limits."""

    kind: np.ndarray
    points: np.ndarray
    hand: np.ndarray
    error: np.ndarray
    limit_force: np.ndarray
    residual: np.ndarray
    margin: np.ndarray


def classify_ends(problem: Problem, limits: Node | None, outcomes: Outcomes) -> Ends:
    """Find out what kind of end each rollout came to.

    At rest, the forces on every joint balance. If the joint-limit leaf pushes a joint, by more than ten times what is
    left over there, the arm stands at that limit: a stop that the report states, for the way on is barred. A rest
    without is a spurious rest point: a minimum of the potential away from the goal.

    **Arguments**: `problem`, what was rolled out; `limits`, the leaf of the joint limits as a node on joint space, None
    without; `outcomes`, by `simulate`, of N rollouts. **Returns** `Ends`.
    """
    q = np.asarray(outcomes.q, np.float32)
    errors = control_point_errors(problem, q)
    force, limit_force = in_blocks(lambda block: _forces(problem, limits, block), q)
    margin = np.minimum(q - np.asarray(problem.lower), np.asarray(problem.upper) - q)
    residual = np.abs(force).max(-1)
    at_limit = (np.abs(limit_force) > np.maximum(_LEAST_FORCE, 10 * np.abs(force))).any(1)
    status = outcomes.status
    kind, resting = np.array(status), status == End.RESTING
    kind[resting] = End.SPURIOUS
    kind[resting & (outcomes.track.touching > 0)] = End.HELD_BY_CONTACT
    kind[resting & (outcomes.track.touching == 0) & at_limit] = End.STOPPED_AT_LIMIT
    return Ends(kind, *errors, limit_force, residual, margin)


def control_point_errors(problem: Problem, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the control points are at N configurations [N, n]: `points`, `hand` and `error`, as in `Ends`."""
    points, hand = in_blocks(lambda block: _points(problem, block), q)
    return points, hand, np.linalg.norm(points, axis=-1).max(-1)


@jax.jit
@partial(jax.vmap, in_axes=(None, None, 0))
@in_lanes
def _forces(problem: Problem, limits: Node | None, q: jax.Array):
    still = jnp.zeros_like(q)
    limit_force = still if limits is None else limits(q, still).f
    return problem.tree(q, still).f, limit_force


_points = jax.jit(jax.vmap(lambda problem, q: (problem.points(q), problem.hand(q)[0]), (None, 0)))
