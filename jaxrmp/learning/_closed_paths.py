"""Paths that no stable policy can follow: closed ones, and such as come back to a place they were at."""

from collections.abc import Callable, Sequence

import numpy as np

from .._errors import DemonstrationError

_LEAVES = 0.03  # m: a path that comes back without having been further away only trembles
_PART = 0.15  # or this part of its extent
_CLOSED = 0.1  # of the extent, between start and end: no kernel is as narrow


def check_paths(
    positions: np.ndarray, subtasks: Sequence[str], tube: float, sample_of: Callable[[int, int, float], int]
) -> None:
    """Check that every path can be followed by a policy that depends on the place alone and comes to rest at the end.

    **Arguments**: `positions` [K, N, T, 3], m, of the K `subtasks` in N demonstrations, the ends at the origin; `tube`,
    m, the width of the tube around them that is learned: a path crosses itself where it passes itself at half of that;
    `sample_of`, called with subtask, demonstration and the fraction of the path's length, the recorded sample.
    **Raises** `DemonstrationError`, by subtask, demonstrations and samples.
    """
    for k, name in enumerate(subtasks):
        closed, crossed = [], []
        for n, path in enumerate(positions[k]):
            extent = float(np.linalg.norm(path, axis=-1).max())
            start = float(np.linalg.norm(path[0]))
            far = max(_LEAVES, _PART * extent)
            if extent > far and start < max(tube, _CLOSED * extent):
                away = sample_of(k, n, float(np.linalg.norm(path, axis=-1).argmax()) / (len(path) - 1))
                closed.append(f"{n} ({100 * start:.1f} cm, after {100 * extent:.0f} cm away at sample {away})")
            elif (found := _meeting(path, tube / 2, far)) is not None:
                first, second = (sample_of(k, n, fraction) for fraction in found)
                crossed.append(f"{n} (samples {first} and {second})")
        if closed:
            raise DemonstrationError(
                f"subtask {name!r} ends where it began in demonstration {', '.join(closed)}. A stable policy rests at "
                "its goal and cannot leave it, so none can follow that. Cut the recordings into motions that end "
                "elsewhere, such as out and back, and learn a skill of each."
            )
        if crossed:
            raise DemonstrationError(
                f"subtask {name!r} crosses its own path in demonstration {', '.join(crossed)}. A stable policy never "
                "comes back to where it was, so none can follow that. Cut the recordings into motions that do not "
                "cross themselves, and learn a skill of each, or leave these demonstrations out."
            )


def _meeting(path: np.ndarray, near: float, far: float) -> tuple[float, float] | None:
    """Two fractions of a path's length at which it is at one place, within `near`, having been `far` away meanwhile."""
    fine = np.linspace(0, len(path) - 1, 5 * len(path))
    x = np.stack([np.interp(fine, np.arange(len(path)), column) for column in path.T], axis=1)
    square = (x * x).sum(1)
    distance = np.sqrt(np.maximum(square[:, None] + square - 2 * x @ x.T, 0))
    since = np.maximum.accumulate(np.triu(distance), axis=1)
    found = np.argwhere((distance < near) & (since > far) & (np.arange(len(x)) > np.arange(len(x))[:, None]))
    if not len(found):
        return None
    i, j = found[distance[tuple(found.T)].argmin()]
    return float(i / (len(x) - 1)), float(j / (len(x) - 1))
