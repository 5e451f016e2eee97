"""How far a reproduction is from its demonstration: dynamic time warping, Frechet, and the distance at the end."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from .._errors import ShapeError
from .._rotations import rotation_angle
from ._arc_length import resample_by_arc_length

_SHORT = 0.01  # m, of a path of which nothing is a share


def dtw_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Mean distance between two paths along their optimal dynamic-time-warping alignment.

    The alignment minimises the sum of Euclidean distances over monotone paths from both starts to both ends; the
    measure is that sum divided by the number of pairs on the path (of equally good steps, the one that advances
    both).

    **Arguments**: `a` [T, m] and `b` [S, m], same units. **Returns** a float in those units.
    **Raises** `ShapeError` if the dimensions differ or a path has no point.

    Sakoe and Chiba 1978, with all three steps at weight one.
    """
    total, pairs = alignments(a, b)
    return float(total / pairs)


def alignments(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least sums of distances over all alignments of paths `a` [..., T, m] and `b` [..., S, m], and how many pairs
    have them, both [...]: all paths of a batch at once, one anti-diagonal after the other. Raises as `dtw_distance`."""
    diagonals = _distances_by_diagonal(a, b)
    _, last = next(diagonals)
    before, pairs_before, pairs_last = np.full_like(last, np.inf), np.zeros_like(last), np.ones_like(last)
    for at, now in diagonals:
        both, first, second = _predecessors(before, last, at)
        pairs_both, *pairs_one = _predecessors(pairs_before, pairs_last, at)
        one, pairs = np.minimum(first, second), np.zeros_like(now)
        now[..., at] += np.minimum(both, one)
        pairs[..., at] = 1 + np.where(both <= one, pairs_both, np.where(first <= second, *pairs_one))
        before, last, pairs_before, pairs_last = last, now, pairs_last, pairs
    return last[..., -1], pairs_last[..., -1]


def discrete_frechet(a: np.ndarray, b: np.ndarray) -> float:
    """The shortest leash with which both paths can be walked point by point, neither ever stepping back.

    **Arguments**: `a` [T, m] and `b` [S, m], same units. **Returns** a float in those units.
    **Raises** `ShapeError` if the dimensions differ or a path has no point.

    Eiter and Mannila 1994.
    """
    diagonals = _distances_by_diagonal(a, b)
    _, last = next(diagonals)
    before = np.full_like(last, np.inf)
    for at, now in diagonals:
        now[..., at] = np.maximum(np.minimum.reduce(_predecessors(before, last, at)), now[..., at])
        before, last = last, now
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


def turn_errors(demonstrated: np.ndarray, rolled: np.ndarray, samples: int = 200) -> dict[str, float | None]:
    """How far a rigid hand is from its demonstration in place and turn.

    Both ways are resampled to `samples` hands, even in the path of the corners, and put together by dynamic time
    warping of the corners, place and turn at once; the means are over the pairs of that alignment.

    **Arguments**: `demonstrated` [T, 3, 3] and `rolled` [S, 3, 3], m, corners of a triangle on the hand, in one frame.
    **Returns** `position_percent`, the mean distance of the triangles' middles in percent of the path that the
    demonstrated one goes, None if that is less than 1 cm; `turn_deg`, the mean angle between the hands, and
    `goal_turn_deg`, that in the end, degrees.
    **Raises** `ShapeError` if the shapes are others.
    """
    shapes = np.shape(demonstrated), np.shape(rolled)
    if any(len(shape) != 3 or shape[1:] != (3, 3) for shape in shapes):
        raise ShapeError(f"hands have shapes {shapes[0]} and {shapes[1]}, expected [T, 3, 3] and [S, 3, 3].")
    ways = [resample_by_arc_length(np.reshape(way, (-1, 9)), samples) for way in (demonstrated, rolled)]
    a, b = (way[rows].reshape(-1, 3, 3) for way, rows in zip(ways, _warped(*ways), strict=True))
    path = np.linalg.norm(np.diff(np.mean(demonstrated, axis=1), axis=0), axis=1).sum()
    angles = np.degrees(_angles(a, b))
    return {
        "position_percent": 100 * float(np.linalg.norm(a.mean(1) - b.mean(1), axis=1).mean() / path)
        if path > _SHORT
        else None,
        "turn_deg": float(angles.mean()),
        "goal_turn_deg": float(angles[-1]),
    }


def _warped(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rows of paths `a` [T, m] and `b` [S, m] that belong together by `dtw_distance`, each [P]."""
    T, S = len(a), len(b)
    distances = np.linalg.norm(a[:, None] - b, axis=-1).tolist()
    total = [[np.inf] * (S + 1) for _ in range(T + 1)]  # the least sum to each pair, with a row and a column before
    total[0][0] = 0.0
    for i, row in enumerate(distances):
        for j, distance in enumerate(row):
            total[i + 1][j + 1] = distance + min(total[i][j], total[i][j + 1], total[i + 1][j])
    pairs, i, j = [], T, S
    while i:
        pairs.append((i - 1, j - 1))
        i, j = min(((i - 1, j - 1), (i - 1, j), (i, j - 1)), key=lambda at: total[at[0]][at[1]])
    rows, columns = np.array(pairs[::-1]).T
    return rows, columns


def _angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The angles [T], rad, between triangles `a` and `b` [T, 3, 3] of the same shape."""
    first, second = (np.stack(_axes(triangles), axis=-1) for triangles in (a, b))
    return rotation_angle(first @ np.swapaxes(second, 1, 2))


def _axes(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes [T, 3] of triangles [T, 3, 3]: along a side, in the plane across it, and out of the plane."""
    side, other = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    x = side / np.linalg.norm(side, axis=1, keepdims=True)
    z = np.cross(x, other)
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return x, np.cross(z, x), z


def time_aligned_error(
    demo_times: np.ndarray, demo_points: np.ndarray, rollout_times: np.ndarray, rollout_points: np.ndarray
) -> float:
    """How far a rollout is from its demonstration at the same time, in centimetres: the root of the mean square over
    the demonstration's time, averaged over the control points.

    **Arguments**: `demo_times` [T], even, and `rollout_times` [S], s since the start; `demo_points` [T, K, 3] and
    `rollout_points` [S, K, 3], m, in one frame. A rollout that ends earlier stays where it ends.
    **Raises** `ShapeError` if the shapes do not fit together.
    """
    demo, rollout = np.asarray(demo_points, float), np.asarray(rollout_points, float)
    if demo.shape != (len(demo_times), *rollout.shape[1:]) or len(rollout) != len(rollout_times) or demo.ndim != 3:
        raise ShapeError(
            f"demo_points has shape {demo.shape} at {len(demo_times)} times, rollout_points {rollout.shape} at "
            f"{len(rollout_times)}: expected [T, K, 3] and [S, K, 3]."
        )
    columns = rollout.reshape(len(rollout), -1).T
    then = np.stack([np.interp(demo_times, rollout_times, column) for column in columns], axis=1).reshape(demo.shape)
    return 100 * float(np.sqrt(((demo - then) ** 2).sum(-1).mean(0)).mean())


def mean_errors(errors: Sequence[Mapping[str, float | None]]) -> dict[str, Any]:
    """The mean of each of the `errors` by name, None where one was not measured."""
    columns = {name: [e[name] for e in errors] for name in errors[0]}
    return {name: None if None in column else float(np.mean(column)) for name, column in columns.items()}  # type: ignore[arg-type]


def _distances_by_diagonal(a: np.ndarray, b: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
    """Distances between all points: [..., T + 1] for each anti-diagonal i + j in turn, with point i in column i + 1.

    The slice says which columns have a pair; the others are infinite, column 0 among them.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    if a.ndim < 2 or a.ndim != b.ndim or a.shape[-1] != b.shape[-1] or 0 in (*a.shape, *b.shape):
        raise ShapeError(
            f"paths have shapes {a.shape} and {b.shape}, expected [T, m] and [S, m] with at least a point."
        )
    T, S = a.shape[-2], b.shape[-2]
    a, backwards = (np.ascontiguousarray(np.moveaxis(path, -1, 0)) for path in (a, b[..., ::-1, :]))
    for k in range(T + S - 1):
        first, end = max(0, k - S + 1), min(k + 1, T)
        offsets = a[..., first:end] - backwards[..., first + S - 1 - k : end + S - 1 - k]
        row = np.full((*a.shape[1:-1], T + 1), np.inf)
        row[..., first + 1 : end + 1] = np.sqrt((offsets * offsets).sum(0))
        yield slice(first + 1, end + 1), row


def _predecessors(before: np.ndarray, last: np.ndarray, at: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values at (i - 1, j - 1), (i - 1, j), (i, j - 1) for the i of a diagonal, from the two before it."""
    shifted = slice(at.start - 1, at.stop - 1)
    return before[..., shifted], last[..., shifted], last[..., at]
