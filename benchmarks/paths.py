"""How well handwriting is reproduced by one flow, and from where its policy arrives: shapes of $JAXRMP_DATA/lair."""

import os
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from jax.tree_util import Partial

from jaxrmp import FileWarning
from jaxrmp.learning import PathLearning, learn_paths, load_paths
from jaxrmp.learning._reproduce import itself, rollouts_of

_GRID, _BEYOND = 16, 0.15  # starts a side, and how far beyond the paths' box
_ARRIVED = 0.01  # of the paths' extent


def rows() -> list[dict[str, Any]]:
    """One row a shape, default settings, errors in the paths' own units; none, and why, without the recordings."""
    folder = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "lair"
    files = sorted(folder.glob("*.npz"))
    if not files:
        return [{"name": "skipped", "why": f"no recordings in $JAXRMP_DATA/lair ({folder})"}]
    return [_row(file) for file in files]


def _row(file: Path) -> dict[str, Any]:
    clock = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FileWarning)  # that they cross is what they are chosen for
        found = learn_paths(load_paths(file))
    seconds = time.perf_counter() - clock
    points = np.concatenate(found.paths)
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    return {
        "name": file.stem,
        "extent": extent,
        **{name: found.mean[name] for name in ("dtw", "frechet")},
        "worst_frechet": max(e["frechet"] for e in found.errors),
        "least_stretch": found.fit.stretch[0],
        "most_stretch": found.fit.stretch[1],
        "coordinates": points.shape[1] + (found.lift is not None),
        **_arrivals(found, points, extent),
        "seconds": seconds,
    }


def _arrivals(found: PathLearning, points: np.ndarray, extent: float) -> dict[str, float]:
    lower, upper = points.min(0), points.max(0)
    beyond = _BEYOND * (upper - lower)
    sides = [np.linspace(a, b, _GRID) for a, b in zip(lower - beyond, upper + beyond, strict=True)]
    starts = found.start(np.stack(np.meshgrid(*sides), -1).reshape(-1, len(sides)))
    rollouts = rollouts_of(Partial(itself, found.policy), (), starts, 3000 * found.dt, found.dt)
    gone = np.linalg.norm(rollouts.q[:, -1, : len(sides)] - found.goal, axis=1)
    rise = np.maximum(np.diff(rollouts.energy.astype(float), axis=1), 0).max(1) / np.ptp(rollouts.energy, axis=1)
    return {"arrive": float((gone < _ARRIVED * extent).mean()), "energy_increase": float(rise.max())}
