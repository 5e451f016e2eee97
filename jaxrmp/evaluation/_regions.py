"""Starts by region: where around the base the hand was, and how far from its goal."""

import itertools
from collections.abc import Iterator

import numpy as np

_SIDES = ("front", "left", "behind", "right")
_DISTANCES = (0.25, 0.5, 1.0)


def regions(hand: np.ndarray, error: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Names and members of the regions of starts; every start is in one by side and in one by distance.

    **Arguments**: `hand` [N, 3], the first control point at the start in the arm's base, m, x to the front, y to the
    left; `error` [N], the largest distance of a control point to its target at the start, m.
    **Yields** name and a mask [N], for regions that are not empty.
    """
    side = np.round(np.arctan2(hand[:, 1], hand[:, 0]) / (np.pi / 2)).astype(int) % 4
    for i, name in enumerate(_SIDES):
        if (side == i).any():
            yield f"hand {name}", side == i
    edges = (0.0, *_DISTANCES, np.inf)
    for low, high in itertools.pairwise(edges):
        inside = (error >= low) & (error < high)
        if inside.any():
            yield f"{f'{low:g} to {high:g}' if np.isfinite(high) else f'over {low:g}'} m from the goal", inside
