"""How long a skill takes to learn: the training loop against PyTorch, the other steps, and all of it from the start."""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jaxrmp.learning import nominal_demonstration, prepare, save_skill
from jaxrmp.learning._potential_program import fit_potential

from . import _training
from ._children import in_child
from ._plots import bars
from ._skills import configuration, demonstrations, learned, source_here


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """The metrics' loop by us and by PyTorch; one convex program; DTW; and whole skills in fresh processes.

    Whole skills, from importing jaxrmp to the saved file, with nothing compiled before and with the compilation cache.
    """
    found = _training.rows(quick) if _has_torch() else []
    found += steps(quick)
    for task in () if quick else ("drawer_closing", "door_reaching"):
        with tempfile.TemporaryDirectory() as folder:
            cache = {"JAX_COMPILATION_CACHE_DIR": folder, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
            for state in ("cold", "warm"):
                found.append({"name": f"{task}, {state} cache", **in_child("benchmarks.learning:whole", task, **cache)})
    return found


def figure(found: list[dict[str, Any]]) -> Any:
    """Seconds of each."""
    return bars(found, ("total_s", "loop_s", "step_s"), "seconds")


def steps(quick: bool) -> list[dict[str, Any]]:
    """One row each: the potential's convex program, and the nominal demonstration by DTW, of one subtask."""
    settings = configuration("drawer_closing", quick)
    prepared = prepare(settings, settings.load_robot(), demonstrations("drawer_closing", source_here(quick)))
    positions, directions = prepared.subtasks.positions[0], prepared.subtasks.directions[0]
    nominal, _ = nominal_demonstration(list(positions))
    p = settings.potential
    how = {"sharpness": p.sharpness, "regularization": p.regularization, "end_weight": p.end_weight}
    calls: dict[str, Callable[[], Any]] = {
        "convex program of one potential": lambda: fit_potential(positions[nominal], directions[nominal], 0.04, **how),
        f"DTW, {len(positions)} demonstrations, all pairs": lambda: nominal_demonstration(list(positions)),
    }
    return [{"name": name, "step_s": _seconds(call, 1 if quick else 7)} for name, call in calls.items()]


def whole(task: str) -> dict[str, Any]:
    """Learn and save a skill, in a process that has done nothing else: seconds of all and of the slow steps."""
    with tempfile.TemporaryDirectory() as folder:
        learning = learned(task, source_here())
        save_skill(learning.skill, Path(folder) / "skill.npz")
    since_start = time.clock_gettime(time.CLOCK_BOOTTIME) - _start_of_process()
    return {
        "total_s": since_start,
        **{f"{step}_s": seconds for step, seconds in learning.seconds.items()},
        "source": source_here(),
    }


def _start_of_process() -> float:
    """When this process was started, in seconds since the machine was (Linux)."""
    fields = Path("/proc/self/stat").read_text().rsplit(")", 1)[1].split()
    return int(fields[19]) / os.sysconf("SC_CLK_TCK")


def _seconds(call: Callable[[], Any], count: int) -> float:
    call()
    taken = []
    for _ in range(count):
        start = time.perf_counter()
        call()
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def _has_torch() -> bool:
    try:
        import torch  # noqa: F401
    except ImportError:
        return False
    return True
