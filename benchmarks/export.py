"""Policies as C that stands alone: one call, against what `compiled` makes of the same, and against fabrics' C."""

import ctypes
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxrmp import acceleration, compiled, export
from jaxrmp._pytree import single
from jaxrmp.learning import load_skill
from jaxrmp.policies import whole_arm_policy
from jaxrmp.world import World
from jaxrmp.xla import layout

from ._plots import bars
from ._policies import panda_24_pairs, states
from ._skills import skill_file
from ._timing import call_times, ratio
from .peers import PEERS_PYTHON, Fabrics

FLAGS = ("-O2", "-O3 -march=native")


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """A row for each way to call a policy, in float32 and in turns: by the file that `export.c` writes, compiled by gcc
    with different options; from Python by `compiled` with `backend="c"`, and by `compiled`.

    `times_faster`, than `compiled`; `than_fabrics`, than its exported C, where it is installed (`make peers`).
    """
    policy = panda_24_pairs()
    turns = 3 if quick else 30
    found = _measured("24 pairs", policy, policy.moving, turns, PEERS_PYTHON.exists())
    skill = load_skill(skill_file("drawer_closing", quick=quick, method="flow"))
    arm = whole_arm_policy(skill, skill.load_robot())

    def whole(T: jax.Array, q: jax.Array, qd: jax.Array) -> jax.Array:
        return acceleration(arm.tree(T, World()), q, qd)

    return found + _measured("flow drawer, whole arm", whole, single(np.asarray(skill.T_world_object)), turns, False)


def figure(found: list[dict[str, Any]]) -> Any:
    """One call of each."""
    return bars(found, ("median_us",), "microseconds a call")


def _measured(what: str, function: Callable, moving: Any, turns: int, fabrics: bool) -> list[dict[str, Any]]:
    Q, QD = states(256)
    source = export.c(function, moving, Q[0], QD[0], names=("moving", "q", "qd"))
    size = {"source_kb": len(source.source.encode()) / 1e3, "operations": source.operations}
    calls: dict[str, Callable[[int], Any]] = {}
    facts: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for flags in FLAGS:
            start = time.perf_counter()
            calls[f"C, gcc {flags}"] = _by_gcc(source, Path(folder), flags, moving, Q, QD)
            facts[f"C, gcc {flags}"] = {**size, "compile_s": time.perf_counter() - start}
        examples = moving, Q[0], QD[0]
        for name, call in (
            ('compiled, backend="c"', compiled(function, *examples, backend="c")),
            ("compiled", compiled(function, *examples)),
        ):
            calls[name] = lambda i, call=call: call(moving, Q[i % 256], QD[i % 256])
        taken: dict[str, list[float]] = {name: [] for name in calls}
        peer = Fabrics().__enter__() if fabrics else None
        try:
            theirs = []
            for _ in range(turns):
                for name, call in calls.items():
                    taken[name].append(float(np.median(call_times(call, 500))))
                if peer:
                    theirs.append(float(np.median(peer.calls("c", 300))))
        finally:
            if peer:
                peer.__exit__()
    rows = []
    for name, values in taken.items():
        row: dict[str, Any] = {"name": f"{what}: {name}", "median_us": float(np.median(values))}
        row["times_faster"] = ratio(np.array(taken["compiled"]), np.array(values))
        if theirs:
            row["than_fabrics"] = ratio(np.array(theirs), np.array(values))
        rows.append({**row, **facts.get(name, {})})
    return rows


def _by_gcc(
    source: export.CSource, folder: Path, flags: str, moving: Any, Q: np.ndarray, QD: np.ndarray
) -> Callable[[int], Any]:
    """A call of the compiled file with its inputs in place, as fabrics' C is called."""
    file, _ = source.write(folder)
    library = folder / f"{flags.replace(' ', '')}.so"
    command = ["gcc", "-std=c99", *flags.split(), "-fPIC", "-shared", str(file), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    function = getattr(ctypes.CDLL(str(library)), source.name)
    function.argtypes, function.restype = [ctypes.c_void_p] * 2, None
    given, found = np.zeros(len(Q), layout(source.inputs)), np.zeros((), layout(source.outputs))
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(moving)]
    for field, values in zip(source.inputs, [*leaves, Q, QD], strict=True):
        given[field.name] = values
    into, places = found.ctypes.data, [given.ctypes.data + k * given.itemsize for k in range(len(Q))]
    return lambda i, kept=(given, found): function(places[i % len(places)], into)
