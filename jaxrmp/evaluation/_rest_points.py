"""Places where rollouts came to rest and should not have, gathered from the ends of many."""

from typing import Any

import numpy as np

from ..learning._basin import cluster


def rest_points(
    q: np.ndarray, points: np.ndarray, members: np.ndarray, starts: int, radius: float = 0.03
) -> list[dict[str, Any]]:
    """Rest points as the report has them: where, and which share of the starts ends there.

    **Arguments**: `q` [N, n], `points` [N, K, 3], the ends of all rollouts; `members` [M], the indices of those that
    came to rest wrongly; `starts`, of how many; `radius`, m, within which ends are one point.
    """
    found = []
    for group in cluster(points[members].reshape(len(members), points[0].size), radius * np.sqrt(points.shape[1])):
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
