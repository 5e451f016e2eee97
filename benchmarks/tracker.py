"""How noisy the tracker of the recordings is while nothing moves: where the defaults of `TrackerSettings` come from."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from jaxrmp.learning import load_demonstrations

_STILL = 0.002  # joint steps below this, rad summed over the joints and averaged over half a second, count as rest


def rows() -> list[dict[str, Any]]:
    """One row a demonstration with a live tracker, and the mean: the door's pose in the base, while the arm rests."""
    folder = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "franka" / "door_reaching"
    found = []
    for k, demonstration in enumerate(load_demonstrations(folder)):
        T = demonstration.poses["door_handle"]
        if np.ptp(T[:, :3, 3], axis=0).max() > 0:
            found.append({"name": f"demonstration {k}", **_measure(T, demonstration.q)})
    return [
        *found,
        {"name": "mean", **{key: float(np.mean([r[key] for r in found])) for key in found[0] if key != "name"}},
    ]


def _measure(T: np.ndarray, q: np.ndarray) -> dict[str, float]:
    speed = np.abs(np.gradient(q, axis=0)).sum(1)
    moving = np.flatnonzero(np.convolve(speed, np.ones(15) / 15, "same") > _STILL)
    position, turn = T[:, :3, 3], _turns(T[:, :3, :3])
    rests = [slice(15, moving[0]), slice(moving[-1] + 1, None)]  # the first half second is the tracker finding its feet
    new = np.flatnonzero(np.abs(np.diff(position, axis=0)).sum(1) > 0) + 1
    new = new[(new < moving[0]) | (new > moving[-1])]
    return {
        "drift_mm": 1000 * _rms([position[rest].std(0) for rest in rests]),
        "drift_mrad": 1000 * _rms([turn[rest].std(0) for rest in rests]),
        "jitter_mm": 1000 * _rms([np.diff(position[new], 2, axis=0).std(0) / np.sqrt(6)]),
        "jitter_mrad": 1000 * _rms([np.diff(turn[new], 2, axis=0).std(0) / np.sqrt(6)]),
        "shift_mm": 1000 * float(np.linalg.norm(position[rests[1]].mean(0) - position[rests[0]].mean(0))),
    }


def _turns(R: np.ndarray) -> np.ndarray:
    """Small rotations [T, 3] from the first, rad."""
    D = R[0].T @ R
    return 0.5 * np.stack([D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], axis=1)


def _rms(values: list[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
