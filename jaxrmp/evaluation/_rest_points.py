"""Places where rollouts came to rest and should not have, gathered from the ends of many."""

from typing import Any

import numpy as np


def cluster(points: np.ndarray, radius: float) -> list[np.ndarray]:
    """Members of each cluster of points [N, m], largest first: everything within `radius` of its first member."""
    left, found = np.arange(len(points)), []
    while len(left):
        near = ~(np.linalg.norm(points[left] - points[left[0]], axis=-1) >= radius)
        found.append(left[near])
        left = left[~near]
    return sorted(found, key=len, reverse=True)


def rest_points(
    q: np.ndarray, points: np.ndarray, members: np.ndarray, starts: int, radius: float = 0.03
) -> list[dict[str, Any]]:
    """Rest points as the report has them: where, and which share of the starts ends there.

    **Arguments**: `q` [N, n], `points` [N, K, 3], the ends of all rollouts; `members` [M], the indices of those that
    came to rest wrongly; `starts`, of how many; `radius`, m, within which ends are one point.
    """
    found = []
    for group in cluster(points[members].reshape(len(members), points.shape[1] * 3), radius * np.sqrt(points.shape[1])):
        indices = members[group]
        where = points[indices].mean(0)
        found.append(
            {
                "share": len(indices) / starts,
                "error_m": float(np.linalg.norm(where, axis=-1).max()),
                "control_points_from_targets_m": where.tolist(),
                "joints": q[indices[0]].tolist(),
                "starts": indices[:20].tolist(),
            }
        )
    return found
