"""What compiling a policy costs, in fresh processes: seconds and memory, from nothing and from the cache."""

import resource
import tempfile
import time
from pathlib import Path
from typing import Any

import jax

from ._children import in_child
from ._plots import bars
from ._policies import lula_folder, policy_named, states
from ._skills import skill_file

BATCH = 1024


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One row a policy, size and state of the cache. Seconds run from the first call of a jitted policy to its result.

    `trace_s` is Python's share. `grown_mb`: by how much compiling raised the process's largest memory. `program_mb`:
    what the cache holds of it. `working_mb`: what one call needs besides arguments and results.
    """
    names = ["panda_24_pairs", "learned_drawer"] + (["lula_franka"] if lula_folder().is_dir() else [])
    if quick:
        names = ["panda_24_pairs"]
    else:
        skill_file(
            "drawer_closing", method="paper"
        )  # learned before, if need be, rather than by a child that is measured
    found = []
    for name in names:
        for batch in (0,) if quick else (0, BATCH):
            with tempfile.TemporaryDirectory() as folder:
                cache = {"JAX_COMPILATION_CACHE_DIR": folder, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
                for state in ("cold", "cached"):
                    measured = in_child("benchmarks.compilation:compiled", name, batch, **cache)
                    label = f"{name}, batch {batch}" if batch else name
                    measured["program_mb"] = sum(f.stat().st_size for f in Path(folder).iterdir()) / 1e6
                    found.append({"name": f"{label}, {state}", **measured})
    return found


def figure(found: list[dict[str, Any]]) -> Any:
    """Seconds of each."""
    return bars(found, ("compile_s", "trace_s"), "seconds")


def compiled(name: str, batch: int) -> dict[str, float]:
    """Compile and call a policy in this process, which has compiled no other."""
    evaluate = policy_named(name)
    moving = evaluate.moving
    Q, QD = states(max(batch, 1))
    arguments = (moving, Q, QD) if batch else (moving, Q[0], QD[0])
    function = jax.jit(jax.vmap(evaluate, in_axes=(None, 0, 0)) if batch else evaluate)
    before = _largest_memory()
    start = time.perf_counter()
    lowered = function.lower(*arguments)
    trace_s = time.perf_counter() - start
    program = lowered.compile()
    jax.block_until_ready(program(*arguments))
    compile_s = time.perf_counter() - start
    memory: Any = program.memory_analysis()
    return {
        "compile_s": compile_s,
        "trace_s": trace_s,
        "grown_mb": (_largest_memory() - before) / 1e6,
        "working_mb": memory.temp_size_in_bytes / 1e6,
    }


def _largest_memory() -> int:
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
