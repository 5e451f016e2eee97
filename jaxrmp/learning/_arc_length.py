"""Paths resampled even in arc length."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .._errors import ShapeError, UnknownNameError, importing


def resample_by_arc_length(
    x: ArrayLike, samples: int, interpolation: Literal["linear", "cubic"] = "linear"
) -> np.ndarray:
    """Sample a path at points even in its arc length: same geometry, whatever the speed or the pauses.

    Arc length is the sum of chords between the points given.

    **Arguments**: `x` [T, m] or [T, K, m] (one path in all K m coordinates); `samples`, at least 2;
    `interpolation` over arc length, `cubic` by a spline.
    **Returns** [samples, ...], with the path's own first and last points. A path of length zero gives its one point
    `samples` times.
    **Raises** `ShapeError` if there is no point or too few samples; `MissingDependencyError` without scipy (cubic).
    """
    x = np.asarray(x, float)
    if x.ndim < 2 or len(x) == 0 or samples < 2:
        raise ShapeError(f"x has shape {x.shape} and samples is {samples}: expected [T, m] with T >= 1, samples >= 2.")
    path = x.reshape(len(x), -1)
    chords = np.linalg.norm(np.diff(path, axis=0), axis=1)
    moved = np.concatenate([[True], chords > 1e-9 * max(chords.sum(), 1e-12)])
    path = path[moved]
    path[-1] = x[-1].ravel()  # of points closer than rounding the first is kept, at the end the last
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    if length[-1] == 0.0:
        return np.broadcast_to(x[-1], (samples, *x.shape[1:])).copy()
    at = np.linspace(0.0, length[-1], samples)
    if interpolation == "linear" or len(path) < 4:
        even = np.stack([np.interp(at, length, column) for column in path.T], axis=1)
    elif interpolation == "cubic":
        even = cubic_spline(length, path, at)
    else:
        raise UnknownNameError("interpolation", interpolation, ("linear", "cubic"))
    even[0], even[-1] = path[0], path[-1]  # to the last bit
    return even.reshape(samples, *x.shape[1:])


def cubic_spline(t: np.ndarray, x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The cubic spline through `x` [T, n] at strictly increasing `t` [T], evaluated at `at` [S]."""
    with importing("scipy", "learning"):
        from scipy.interpolate import CubicSpline
    return CubicSpline(t, x, axis=0)(at)
