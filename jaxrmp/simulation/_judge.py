"""When a rollout has ended, and what is kept of it on the way: a few numbers a start, no trajectory."""

import dataclasses
import enum
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError
from .._pytree import pytree
from .._task_map import TaskMap
from .._tree import Node


class Status(enum.IntEnum):
    """How it stands with one start. Whether a rest is a stop at a joint limit is found afterwards, from its end."""

    RUNNING = 0
    CONVERGED = 1
    RESTING = 2
    DIVERGED = 3
    TIMED_OUT = 4


@pytree
class StopCriteria:
    """When a rollout ends.

    Converged: every control point within `tolerance` (m) of its target, and no joint faster than `settled` (rad/s or
    m/s). Resting: no joint faster than `rest` for `rest_seconds`. Diverged: a number that is not finite, or a joint
    faster than `top_speed`. Timed out: none of these after `duration` seconds.

    **Raises** `ConfigurationError` for a value that is not a positive number.
    """

    tolerance: float = 0.01
    settled: float = 0.05
    rest: float = 2e-4
    rest_seconds: float = 1.0
    top_speed: float = 1e3
    duration: float = 120.0

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (isinstance(value, int | float) and 0 < value < math.inf):
                raise ConfigurationError(f"{field.name} is {value!r}, expected a positive number.")


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
        """The largest distance of a control point to its target, m."""
        square = jnp.sum(self.points(q) ** 2, axis=-1)
        return jnp.sqrt(jnp.max(square))

    def clearance(self, q: jax.Array) -> jax.Array:
        """The least of all distances, m; infinite where none is watched."""
        least = jnp.full((), jnp.inf, q.dtype)
        for distances in self.distances:
            least = jnp.minimum(least, jnp.min(distances(q), initial=jnp.inf))
        return least


class Track(NamedTuple):
    """What is kept of a rollout; scalars for one start, [B] for a batch.

    `status`; `steps` taken; `still`, steps at rest so far; `energy` V at the start; `least`, the least V so far;
    `rise`, the largest rise of V above its least value before; `speed`, the fastest joint speed; `margin`, the
    smallest distance of a joint to its limits; `clearance`, the smallest there was, m; `touching`, how many contacts
    there are in physics, and `touched`, in how many steps there were some.
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


def judge(
    problem: Problem, criteria: StopCriteria, dt: float, track: Track, q: jax.Array, qd: jax.Array, energy: jax.Array
) -> Track:
    """Take one state of one start into account; a start that has ended stays as it was.

    **Arguments**: `track`, what is kept so far; `q`, `qd` [n], the state; `energy`, its V; `dt`, seconds a step.
    **Returns** the new `Track`, whose `status` says whether the rollout ends in this state.
    """
    speed = jnp.max(jnp.abs(qd))
    margin = jnp.min(jnp.minimum(q - problem.lower, problem.upper - q))
    still = jnp.where(speed < criteria.rest, track.still + 1, 0)
    finite = jnp.isfinite(energy) & jnp.all(jnp.isfinite(q)) & (speed < criteria.top_speed)
    status = jnp.where(track.steps >= jnp.round(criteria.duration / dt), Status.TIMED_OUT, Status.RUNNING)
    status = jnp.where(still * dt >= criteria.rest_seconds, Status.RESTING, status)
    there = (problem.goal_error(q) < criteria.tolerance) & (speed < criteria.settled) & (track.steps > 0)
    status = jnp.where(there, Status.CONVERGED, status)
    status = jnp.where(finite, status, Status.DIVERGED).astype(jnp.int32)
    least = jnp.minimum(track.least, energy)
    seen = Track(
        status=status,
        steps=track.steps + (status == Status.RUNNING),
        still=still,
        energy=jnp.where(track.steps == 0, energy, track.energy),
        least=least,
        rise=jnp.maximum(track.rise, jnp.where(track.steps == 0, 0, energy - track.least)),
        speed=jnp.maximum(track.speed, speed),
        margin=jnp.minimum(track.margin, margin),
        clearance=track.clearance,
        touching=track.touching,
        touched=track.touched,
    )
    ended = track.status != Status.RUNNING
    diverged = status == Status.DIVERGED
    kept = track._replace(status=seen.status)  # of a state that is not finite, only that it came
    return Track(
        *(
            jnp.where(ended, old, jnp.where(diverged, last, new))
            for old, last, new in zip(track, kept, seen, strict=True)
        )
    )
