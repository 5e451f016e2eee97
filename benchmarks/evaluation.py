"""The bars of batch evaluation, by the command line that anyone can call: thousands of starts, three engines.

Skills are those of `benchmarks/physics.py`, learned where they are not there yet. Start i of one engine is start i of
the others, so ends are compared start by start.
"""

import os
from typing import Any

import numpy as np

from jaxrmp.cli import main

from ._report import FOLDER
from ._skills import skill_file

_OUT = FOLDER / "evaluation"
_STARTS = {"kinematic": 4096, "mujoco": 1024, "mjx": 256}
_CONVERGED, _AT_LIMIT = 1, 2


def rows() -> list[dict[str, Any]]:
    """One row a source and engine for the drawer; one a source for the door, kinematic alone. Some two hours."""
    found = []
    for source in ["synthetic"] + (["recordings"] if os.environ.get("JAXRMP_DATA") else []):
        ends = {engine: _ends(source, "drawer_closing", engine, starts) for engine, starts in _STARTS.items()}
        for engine, end in ends.items():
            found.append(_row(f"drawer, {engine}", source, end) | _agreement(end, ends["mujoco"], ends["kinematic"]))
        found.append(_row("door, kinematic", source, _ends(source, "door_reaching", "kinematic", 1024)))
    return found


def _ends(source: str, task: str, engine: str, starts: int) -> dict[str, np.ndarray]:
    report = _OUT / f"{source}_{task}_{engine}.json"
    saved = report.with_suffix(".npz")
    arguments = ["--starts", str(starts), "--physics", engine, "--json", str(report), "--save", str(saved)]
    if main(["evaluate", str(skill_file(task, source)), *arguments]):
        raise SystemExit(f"jaxrmp evaluate {' '.join(arguments)} failed")
    with np.load(saved) as file:
        return dict(file)


def _row(name: str, source: str, end: dict[str, np.ndarray]) -> dict[str, Any]:
    kind, rise = end["kind"], end["energy_increase"]
    return {
        "name": name,
        "source": source,
        "starts": len(kind),
        "non_finite": int((~np.isfinite(rise)).sum()),
        "converged_percent": 100 * float((kind == _CONVERGED).mean()),
        "at_limit_percent": 100 * float((kind == _AT_LIMIT).mean()),
        "energy_increase": float(rise.max()),
        "touched": int((end["touched"] > 0).sum()),
        "min_clearance_mm": 1000 * float(end["clearance"].min()),
    }


def _agreement(
    end: dict[str, np.ndarray], native: dict[str, np.ndarray], free: dict[str, np.ndarray]
) -> dict[str, Any]:
    """Against native MuJoCo: starts that end otherwise, and the largest distance of a hand's ends; against kinematic:
    the difference of the converged share, all on the starts that both have."""
    both, common = min(len(end["kind"]), len(native["kind"])), min(len(end["kind"]), len(free["kind"]))
    apart = np.linalg.norm(end["points"][:both] - native["points"][:both], axis=-1).max(-1)
    share = [float((e["kind"][:common] == _CONVERGED).mean()) for e in (end, free)]
    return {
        "other_end_than_native": int((end["kind"][:both] != native["kind"][:both]).sum()),
        "apart_from_native_mm": 1000 * float(apart.max()),
        "converged_less_kinematic_percent": 100 * (share[0] - share[1]),
    }
