"""How far a reproduction is from its demonstration: dynamic time warping, Frechet, and the distance at the end."""

import numpy as np

from .._errors import ShapeError
from ._arc_length import resample_by_arc_length


def dtw_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Mean distance between two paths along their optimal dynamic-time-warping alignment.

    The alignment minimises the sum of Euclidean distances over monotone paths from both starts to both ends; the
    measure is that sum divided by the number of pairs on the path (of equally good steps, the one that advances
    both).

    **Arguments**: `a` [T, m] and `b` [S, m], same units. **Returns** a float in those units.
    **Raises** `ShapeError` if the dimensions differ or a path has no point.

    Sakoe and Chiba 1978, with all three steps at weight one.
    """
    cost = _distances_by_diagonal(a, b)
    rows = np.arange(cost.shape[1] - 1)
    before, last = np.full_like(cost[0], np.inf), cost[0]
    pairs_before, pairs_last = np.zeros_like(cost[0]), np.ones_like(cost[0])
    for distances in cost[1:]:
        totals = _predecessors(before, last)
        best = np.argmin(totals, axis=0)
        total, pairs = np.full_like(last, np.inf), np.zeros_like(last)
        total[1:] = totals[best, rows] + distances[1:]
        pairs[1:] = _predecessors(pairs_before, pairs_last)[best, rows] + 1.0
        before, last, pairs_before, pairs_last = last, total, pairs_last, pairs
    return float(last[-1] / pairs_last[-1])


def discrete_frechet(a: np.ndarray, b: np.ndarray) -> float:
    """The shortest leash with which both paths can be walked point by point, neither ever stepping back.

    **Arguments**: `a` [T, m] and `b` [S, m], same units. **Returns** a float in those units.
    **Raises** `ShapeError` if the dimensions differ or a path has no point.

    Eiter and Mannila 1994.
    """
    cost = _distances_by_diagonal(a, b)
    before, last = np.full_like(cost[0], np.inf), cost[0]
    for distances in cost[1:]:
        leash = np.full_like(last, np.inf)
        leash[1:] = np.maximum(_predecessors(before, last).min(axis=0), distances[1:])
        before, last = last, leash
    return float(last[-1])


def reproduction_errors(demo_points: np.ndarray, rollout_points: np.ndarray, samples: int = 200) -> dict[str, float]:
    """How far a rollout is from its demonstration, in centimetres, averaged over the control points.

    Each point's path is resampled to `samples` points even in arc length before it is compared.

    **Arguments**: `demo_points` [T, K, 3] and `rollout_points` [S, K, 3], m, in one frame.
    **Returns** `dtw_cm` (`dtw_distance`), `frechet_cm` (`discrete_frechet`), `goal_cm` (distance of the last points).
    **Raises** `ShapeError` if the shapes do not fit together.
    """
    demo, rollout = np.asarray(demo_points, float), np.asarray(rollout_points, float)
    if demo.ndim != 3 or rollout.ndim != 3 or demo.shape[1:] != rollout.shape[1:]:
        raise ShapeError(
            f"demo_points has shape {demo.shape}, rollout_points {rollout.shape}: expected [T, K, 3] and [S, K, 3]."
        )
    paths = [
        (resample_by_arc_length(demo[:, k], samples), resample_by_arc_length(rollout[:, k], samples))
        for k in range(demo.shape[1])
    ]
    return {
        "dtw_cm": 100 * float(np.mean([dtw_distance(a, b) for a, b in paths])),
        "frechet_cm": 100 * float(np.mean([discrete_frechet(a, b) for a, b in paths])),
        "goal_cm": 100 * float(np.linalg.norm(demo[-1] - rollout[-1], axis=-1).mean()),
    }


def _distances_by_diagonal(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances between all points, one row for each anti-diagonal i + j, with point i in column i + 1.

    Entries with no such pair are infinite, column 0 among them. [T + S - 1, T + 1].
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    if a.ndim != 2 or b.ndim != 2 or a.shape[1] != b.shape[1] or 0 in (*a.shape, *b.shape):
        raise ShapeError(
            f"paths have shapes {a.shape} and {b.shape}, expected [T, m] and [S, m] with at least a point."
        )
    i, j = np.indices((len(a), len(b)))
    rows = np.full((len(a) + len(b) - 1, len(a) + 1), np.inf)
    rows[i + j, i + 1] = np.linalg.norm(a[:, None] - b[None], axis=-1)
    return rows


def _predecessors(before: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Values at (i - 1, j - 1), (i - 1, j), (i, j - 1) for all i of a diagonal, from the two before it. [3, T]."""
    return np.stack([before[:-1], last[:-1], last[1:]])
