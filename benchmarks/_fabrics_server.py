"""fabrics (tud-amr) on the 24-pair scene, in an environment of its own: `make peers`. It imports nothing of ours.

Started with one argument, a JSON file of the scene and a folder. Reads lines `python N` and `c N` from standard input,
and answers each with a line of JSON: the microseconds of N calls, over the scene's states in turn. A line `check` is
answered with how far the two are apart. The exported C is compiled with `gcc -O0`; -O1 does not finish.
"""

import ctypes
import json
import logging
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from fabrics.planner.parameterized_planner import ParameterizedFabricPlanner
from forwardkinematics.urdfFks.generic_urdf_fk import GenericURDFFk
from mpscenes.goals.goal_composition import GoalComposition

logging.getLogger().setLevel(logging.ERROR)


def main() -> None:
    scene = json.loads(Path(sys.argv[1]).read_text())
    planner = make_planner(scene)
    fixed = fixed_inputs(scene)
    states = [(np.array(q), np.array(qd)) for q, qd in zip(scene["q"], scene["qd"], strict=True)]

    def by_python(i):
        q, qd = states[i % len(states)]
        return planner.compute_action(q=q, qdot=qd, **fixed)

    by_python(0)
    by_c = exported(planner, states, Path(sys.argv[1]).parent)
    print(json.dumps("ready"), flush=True)
    for line in sys.stdin:
        what, *count = line.split()
        if what == "check":
            print(json.dumps(largest_difference(planner, states, fixed, by_c)), flush=True)
            continue
        call = by_python if what == "python" else by_c
        taken = []
        for i in range(int(count[0])):
            start = time.perf_counter_ns()
            call(i)
            taken.append((time.perf_counter_ns() - start) / 1e3)
        print(json.dumps(taken), flush=True)


def make_planner(scene: dict) -> ParameterizedFabricPlanner:
    """The planner with its default leaves: the goal, two limits a joint, every robot sphere against every obstacle."""
    chain = GenericURDFFk(scene["urdf"], root_link=scene["root"], end_links=[scene["hand"]])
    planner = ParameterizedFabricPlanner(len(scene["lower"]), chain)
    goal = {
        "weight": 1.0,
        "is_primary_goal": True,
        "indices": [0, 1, 2],
        "parent_link": scene["root"],
        "child_link": scene["hand"],
        "desired_position": scene["goal"],
        "epsilon": 0.05,
        "type": "staticSubGoal",
    }
    planner.set_components(
        collision_links=list(scene["spheres"]),
        goal=GoalComposition(name="goal", content_dict={"subgoal0": goal}),
        limits=[list(pair) for pair in zip(scene["lower"], scene["upper"], strict=True)],
        number_obstacles=len(scene["obstacles"]),
    )
    planner.concretize()
    wanted = 1 + 2 * len(scene["lower"]) + len(scene["spheres"]) * len(scene["obstacles"])
    if len(planner.leaves) != wanted:  # it passes over links whose position does not depend on all coordinates
        raise RuntimeError(f"the planner has {len(planner.leaves)} leaves, expected {wanted}: {list(planner.leaves)}")
    return planner


def fixed_inputs(scene: dict) -> dict:
    """All that does not change from call to call."""
    found = {"x_goal_0": np.array(scene["goal"]), "weight_goal_0": np.array([1.0])}
    for link, radius in scene["spheres"].items():
        found[f"radius_body_{link}"] = np.array([radius])
    for i, (center, radius) in enumerate(scene["obstacles"]):
        found[f"x_obst_{i}"] = np.array(center)
        found[f"radius_obst_{i}"] = np.array([radius])
    return found


def largest_difference(planner: ParameterizedFabricPlanner, states: list, fixed: dict, by_c) -> float:
    """Between Python and C, relative to the size of the action; `compute_action` turns very large ones into zeros."""
    worst = 0.0
    for i, (q, qd) in enumerate(states):
        action = planner._funs.evaluate(q=q, qdot=qd, **fixed)["action"]
        worst = max(worst, float(np.abs(action - by_c(i)).max() / np.abs(action).max()))
    return worst


def exported(planner: ParameterizedFabricPlanner, states: list, folder: Path):
    """The planner's C, compiled and called through ctypes with its inputs already in place."""
    planner.export_as_c(str(folder / "planner.c"))
    source, library = folder / "planner.c", folder / "planner.so"
    subprocess.run(["gcc", "-O0", "-shared", "-fPIC", str(source), "-o", str(library), "-lm"], check=True)
    c = ctypes.CDLL(str(library))
    function = planner._funs.function()
    name = function.name()
    values = planner._funs._argument_dictionary
    sizes = [ctypes.c_longlong() for _ in range(4)]
    getattr(c, f"{name}_work")(*(ctypes.byref(size) for size in sizes))
    work = [max(int(size.value), 1) for size in sizes]
    output = np.zeros(function.numel_out(0))
    integers, reals = np.zeros(work[2], np.int64), np.zeros(work[3])
    results = (ctypes.c_void_p * work[1])(output.ctypes.data)
    names = [function.name_in(i) for i in range(function.n_in())]
    calls, kept = [], []
    for q, qd in states:
        given = {**values, "q": q, "qdot": qd}
        arrays = [np.ascontiguousarray(given[n], float).reshape(-1) for n in names]
        kept.append(arrays)
        calls.append((ctypes.c_void_p * work[0])(*(a.ctypes.data for a in arrays)))
    run = getattr(c, name)
    run.argtypes = [ctypes.c_void_p] * 4 + [ctypes.c_int]
    memory = integers.ctypes.data, reals.ctypes.data

    def call(i, kept=kept):
        run(calls[i % len(calls)], results, *memory, 0)
        return output

    return call


main()
