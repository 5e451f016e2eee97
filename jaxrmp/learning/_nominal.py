"""The nominal demonstration: the one closest to all others."""

from collections.abc import Sequence

import numpy as np

from .._errors import DemonstrationError, MissingDependencyError, ShapeError


def nominal_demonstration(trajectories: Sequence[np.ndarray]) -> tuple[int, np.ndarray]:
    """Choose the demonstration with the least mean dynamic-time-warping distance to the others.

    The distance is the least sum of Euclidean distances over all alignments, so trajectories should have about as
    many points each. Of equals, the first.

    **Arguments**: `trajectories`, N arrays [T, m] in one unit.
    **Returns** the index of the nominal one, and the symmetric matrix [N, N] of distances, zero on its diagonal.
    **Raises** `DemonstrationError` for fewer than two; `ShapeError` if the dimensions differ; `MissingDependencyError`
    without dtaidistance.

    Rana et al. 2019, section 3.1.
    """
    paths = [np.ascontiguousarray(path, dtype=np.float64) for path in trajectories]  # as the C code wants them
    if len(paths) < 2:
        raise DemonstrationError(f"received {len(paths)} trajectory, but choosing a nominal one takes at least two.")
    if any(path.ndim != 2 or path.shape[1:] != paths[0].shape[1:] or 0 in path.shape for path in paths):
        raise ShapeError(f"trajectories have shapes {[path.shape for path in paths]}, expected [T, m] with one m.")
    try:
        from dtaidistance import dtw_ndim
    except ImportError as error:
        raise MissingDependencyError("dtaidistance", "learning") from error
    n = len(paths)
    distances = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1, n):
            distances[i, j] = distances[j, i] = dtw_ndim.distance_fast(paths[i], paths[j], inner_dist="euclidean")
    return int(np.argmin(distances.sum(axis=1))), distances
