"""The nominal demonstration: the one closest to all others."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from .._errors import DemonstrationError, ShapeError
from ._measures import alignments


def nominal_demonstration(trajectories: Sequence[np.ndarray]) -> tuple[int, np.ndarray]:
    """Choose the demonstration with the least mean dynamic-time-warping distance to the others.

    The distance is the least sum of Euclidean distances over all alignments, so trajectories should have about as
    many points each. Of equals, the first.

    **Arguments**: `trajectories`, N arrays [T, m] in one unit.
    **Returns** the index of the nominal one, and the symmetric matrix [N, N] of distances, zero on its diagonal.
    **Raises** `DemonstrationError` for fewer than two; `ShapeError` if the dimensions differ.

    Rana et al. 2019, section 3.1.
    """
    paths = [np.asarray(path, float) for path in trajectories]
    if len(paths) < 2:
        raise DemonstrationError(f"received {len(paths)} trajectory, but choosing a nominal one takes at least two.")
    if any(path.ndim != 2 or path.shape[1:] != paths[0].shape[1:] or 0 in path.shape for path in paths):
        raise ShapeError(f"trajectories have shapes {[path.shape for path in paths]}, expected [T, m] with one m.")
    distances = np.zeros((len(paths), len(paths)))
    alike: dict[tuple[int, int], list[tuple[int, int]]] = {}  # pairs of the same lengths go together
    for i, j in combinations(range(len(paths)), 2):
        alike.setdefault((len(paths[i]), len(paths[j])), []).append((i, j))
    for pairs in alike.values():
        i, j = np.transpose(pairs)
        totals, _ = alignments(np.stack([paths[k] for k in i]), np.stack([paths[k] for k in j]))
        distances[i, j] = distances[j, i] = totals
    return int(np.argmin(distances.sum(axis=1))), distances
