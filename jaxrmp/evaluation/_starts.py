"""Where rollouts start: drawn within joint limits, or around demonstrations, and free of collision."""

from collections.abc import Callable

import numpy as np

from .._errors import ConfigurationError, ShapeError
from ..simulation import Problem
from ..simulation._judge import clearances
from ..xla import in_blocks

_BLOCK = 1024  # draws at a time; part of what a seed means
_DRAWS = 200  # blocks in a row without a free configuration until giving up


def sample_starts(problem: Problem, count: int, *, seed: int = 0, margin: float = 0.05) -> np.ndarray:
    """Configurations drawn evenly within the joint limits, `margin` (rad or m) away from them, free of collision.

    Start i depends on `seed` alone, not on how many are drawn: every one can be drawn again.

    **Arguments**: `problem`, whose distances must all be positive at a start; `count` N.
    **Returns** [N, n], in single precision. A joint without limits is drawn from one turn, -pi to pi.
    **Raises** `ConfigurationError` for no starts, a margin that leaves nothing, or if none drawn is free.
    """
    lower, upper = np.asarray(problem.lower, float), np.asarray(problem.upper, float)
    free = ~(np.isfinite(lower) & np.isfinite(upper))
    lower, upper = np.where(free, -np.pi, lower + margin), np.where(free, np.pi, upper - margin)
    if not (margin >= 0 and (lower < upper).all()):
        raise ConfigurationError(f"margin is {margin!r}, which leaves no room between the joint limits.")
    return _free(problem, count, lambda rng: rng.uniform(lower, upper, (_BLOCK, len(lower))), seed)


def starts_around(
    problem: Problem, configurations: np.ndarray, count: int, *, spread: float, seed: int = 0, margin: float = 0.05
) -> np.ndarray:
    """Configurations drawn evenly within `spread` (rad or m, each joint) of `configurations` [D, n], free of collision.

    Which of them is drawn around is drawn too. They keep `margin` from the joint limits. The rest as `sample_starts`.
    """
    around = np.asarray(configurations, float)
    lower, upper = np.asarray(problem.lower, float) + margin, np.asarray(problem.upper, float) - margin
    if around.ndim != 2 or around.shape[1] != len(lower) or not len(around):
        raise ShapeError(f"configurations has shape {around.shape}, expected [D, {len(lower)}].")
    if not 0 < spread < np.inf:
        raise ConfigurationError(f"spread is {spread!r}, expected a positive number.")

    def draw(rng):
        middle = around[rng.integers(len(around), size=_BLOCK)]
        return np.clip(middle + rng.uniform(-spread, spread, middle.shape), lower, upper)

    return _free(problem, count, draw, seed)


def check_starts(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """Given `starts` [N, n] of `problem`, rad or m, as they are, in single precision.

    **Raises** `ShapeError`; `ConfigurationError` for one that is not finite, outside the joint limits, or in collision.
    """
    starts = np.asarray(starts)
    n = np.shape(problem.lower)[0]
    if starts.ndim != 2 or starts.shape[1] != n or not len(starts):
        raise ShapeError(f"starts has shape {starts.shape}, expected [N, {n}] with at least one start.")
    starts = starts.astype(np.float32)
    outside = ~((starts >= np.asarray(problem.lower)) & (starts <= np.asarray(problem.upper))).all(1)
    if outside.any():
        i = int(np.flatnonzero(outside)[0])
        raise ConfigurationError(
            f"start {i} (and {outside.sum() - 1} more) is outside the joint limits: {np.round(starts[i], 4).tolist()}."
        )
    clearance = _clearances(problem, starts)
    if (clearance <= 0).any():
        i = int(np.argmin(clearance))
        raise ConfigurationError(
            f"start {i} is in collision, by {-1000 * clearance[i]:.0f} mm ({(clearance <= 0).sum()} of {len(starts)} "
            f"starts are): {np.round(starts[i], 4).tolist()}. Leave it out, or move what it touches."
        )
    return starts


def _free(problem: Problem, count: int, draw: Callable[[np.random.Generator], np.ndarray], seed: int) -> np.ndarray:
    if count < 1:
        raise ConfigurationError(f"the number of starts is {count}, expected at least 1.")
    found, have, vain, block = [], 0, 0, 0
    while have < count:
        drawn = draw(np.random.default_rng([seed, block])).astype(np.float32)
        kept = drawn[_clearances(problem, drawn) > 0]
        found.append(kept)
        have, block = have + len(kept), block + 1
        vain = 0 if len(kept) else vain + 1
        if vain == _DRAWS:
            raise ConfigurationError(
                f"none of {_DRAWS * _BLOCK} configurations drawn is free of collision: there is no room for the arm, "
                "or the spread is too narrow."
            )
    return np.concatenate(found)[:count]


def _clearances(problem: Problem, q: np.ndarray) -> np.ndarray:
    if not problem.distances:
        return np.full(len(q), np.inf)
    return in_blocks(lambda block: clearances(problem, block), q, _BLOCK)
