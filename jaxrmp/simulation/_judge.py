"""When a simulation has ended and how, kinematic or in physics, and what is kept of it on the way: a few numbers."""

import enum
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._pytree import pytree
from .._ranges import Positive
from .._task_map import TaskMap
from .._tree import Node
from ..xla import in_lanes


class End(enum.IntEnum):
    """How it stands with one start, or came to stand.

    The judge tells of a rest only that it is one (`RESTING`); `evaluation.classify_ends` says afterwards what holds the
    arm: a joint limit that pushes, a contact, or neither, away from the goal. `TOUCHED` ends a trial of `run_trials`.
    """

    RUNNING = 0
    CONVERGED = 1
    STOPPED_AT_LIMIT = 2
    HELD_BY_CONTACT = 3
    SPURIOUS = 4
    UNFINISHED = 5
    DIVERGED = 6
    RESTING = 7
    TOUCHED = 8


@pytree
class StopCriteria:
    """When a simulation ends; infinite for never.

    Converged: every control point within `tolerance` (m) of its target, and no joint faster than `settled` (rad/s or
    m/s); in `run_trials`, what the scene says. Resting: no joint faster than `rest` for `rest_seconds`. Diverged: a
    number that is not finite, or a joint faster than `top_speed`, one for all or [n]. Unfinished: none of these after
    `duration` seconds.

    **Raises** `ConfigurationError` for a value that is not positive.
    """

    tolerance: Positive[float] = 0.01
    settled: Positive[float] = 0.05
    rest: Positive[float] = 2e-4
    rest_seconds: Positive[float] = 1.0
    top_speed: Positive[Any] = 1e3
    duration: Positive[float] = 120.0


@pytree
class Problem:
    """What is rolled out and what is watched: everything but the starts.

    `tree`, the policy on joint space; `points`, the map from q [n] to the control points [K, 3] with their targets at
    zero, m; `hand`, the map to the same points in the world, m; `lower`, `upper` [n], joint limits; `distances`, maps
    from q to distances [P], m, whose least is the clearance (none: the clearance is infinite).
    """

    tree: Node
    points: TaskMap
    hand: TaskMap
    lower: jax.Array
    upper: jax.Array
    distances: tuple[TaskMap, ...] = ()

    def goal_error(self, q: jax.Array) -> jax.Array:
        """The largest distance of a control point to its target at `q` [n], m."""
        square = jnp.sum(self.points(q) ** 2, axis=-1)
        return jnp.sqrt(jnp.max(square))

    def there(self, criteria: StopCriteria, q: jax.Array, qd: jax.Array) -> jax.Array:
        """Whether a state `q, qd` counts as at the goal, by `criteria`."""
        return (self.goal_error(q) < criteria.tolerance) & (jnp.max(jnp.abs(qd)) < criteria.settled)

    @in_lanes
    def clearance(self, q: jax.Array) -> jax.Array:
        """The least of all distances at `q` [n], m; infinite where none is watched."""
        least = jnp.full((), jnp.inf, q.dtype)
        for distances in self.distances:
            least = jnp.minimum(least, jnp.min(distances(q), initial=jnp.inf))
        return least


@jax.jit
def clearances(problem: Problem, q: jax.Array) -> jax.Array:
    """`Problem.clearance` at configurations `q` [B, n], [B]."""
    return jax.vmap(problem.clearance)(jnp.asarray(q, jnp.float32))


class Track(NamedTuple):
    """What is kept of a simulation; scalars for one start, [B] for a batch.

    `status`, an `End`; `steps` taken; `still`, steps at rest so far; `energy` V at the start; `least`, the least V so
    far; `rise`, the largest rise of V above its least value before; `speed`, the fastest joint speed; `margin`, the
    smallest distance of a joint to its limits; `clearance`, the smallest there was, m; `touching`, how many contacts
    the arm has in physics, and `touched`, in how many steps there were some.
    """

    status: jax.Array
    steps: jax.Array
    still: jax.Array
    energy: jax.Array
    least: jax.Array
    rise: jax.Array
    speed: jax.Array
    margin: jax.Array
    clearance: jax.Array
    touching: jax.Array
    touched: jax.Array

    @classmethod
    def fresh(cls, count: int) -> "Track":
        """Of `count` starts that have not moved."""
        zeros, floats = np.zeros(count, np.int32), np.zeros(count, np.float32)
        far = np.full(count, np.inf, np.float32)
        return cls(zeros, zeros, zeros, floats, far, floats, floats, far, far, zeros, zeros)


class Seen(NamedTuple):
    """What the judge is told of one state.

    `q`, `qd` [n]; `energy` V and `qdd` [n] of the policy there; `margin`, the least distance of a joint to its limits;
    `there`, whether it counts as at the goal; `touched`, whether something was touched that ends it.
    """

    q: jax.Array
    qd: jax.Array
    energy: jax.Array
    qdd: jax.Array
    margin: jax.Array
    there: jax.Array
    touched: jax.Array | bool = False


def margin(q: jax.Array, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """The least distance of a joint to its limits, negative beyond them."""
    return jnp.min(jnp.minimum(q - lower, upper - q))


def judge(criteria: StopCriteria, dt: float, track: Track, state: Seen) -> Track:
    """Take one state of one start into account; a start that has ended stays as it was.

    **Arguments**: `track`, what is kept so far; `dt`, seconds a step.
    **Returns** the new `Track`, whose `status` says whether the simulation ends in this state.
    """
    q, qd, energy = state.q, state.qd, state.energy
    speed = jnp.max(jnp.abs(qd))
    still = jnp.where(speed < criteria.rest, track.still + 1, 0)
    finite = jnp.isfinite(energy) & jnp.all(jnp.isfinite(q)) & jnp.all(jnp.isfinite(state.qdd))
    finite = finite & jnp.all(jnp.abs(qd) < criteria.top_speed)
    status = jnp.where(track.steps >= jnp.round(criteria.duration / dt), End.UNFINISHED, End.RUNNING)
    status = jnp.where(still * dt >= criteria.rest_seconds, End.RESTING, status)
    status = jnp.where(state.there & (track.steps > 0), End.CONVERGED, status)
    status = jnp.where(state.touched, End.TOUCHED, status)
    status = jnp.where(finite, status, End.DIVERGED).astype(jnp.int32)
    seen = Track(
        status=status,
        steps=track.steps + (status == End.RUNNING),
        still=still,
        energy=jnp.where(track.steps == 0, energy, track.energy),
        least=jnp.minimum(track.least, energy),
        rise=jnp.maximum(track.rise, jnp.where(track.steps == 0, 0, energy - track.least)),
        speed=jnp.maximum(track.speed, speed),
        margin=jnp.minimum(track.margin, state.margin),
        clearance=track.clearance,
        touching=track.touching,
        touched=track.touched,
    )
    ended = track.status != End.RUNNING
    diverged = status == End.DIVERGED
    kept = track._replace(status=seen.status)  # of a state that is not finite, only that it came
    parts = zip(track, kept, seen, strict=True)
    return Track(*(jnp.where(ended, old, jnp.where(diverged, last, new)) for old, last, new in parts))


def judged(problem: Problem, criteria: StopCriteria, dt: float, track: Track, q: jax.Array, qd: jax.Array, of: Any):
    """`judge` by the goal of a `problem`, at a state `q`, `qd` [n] where the policy gives the command `of`."""
    near = margin(q, problem.lower, problem.upper)
    return judge(criteria, dt, track, Seen(q, qd, of.energy, of.qdd, near, problem.there(criteria, q, qd)))
