"""What one evaluation of a whole policy costs: called from Python as a control loop would, and in a batch."""

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import Batched, acceleration, pullback
from jaxrmp.cli._sources import default_demonstrations, find_demonstrations, robot_of
from jaxrmp.io import load_lula
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.learning import learn, load_configuration
from jaxrmp.leaves import Attractor, CollisionAvoidance, Damping, JointLimit
from jaxrmp.world import Boxes, ObstacleDistances, Spheres, World

CALLS, BATCH, BATCH_CALLS = 100_000, 1024, 50
QUANTILES = {"median": 0.5, "p99": 0.99, "p999": 0.999}
POSTURE = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)


def rows() -> list[dict[str, Any]]:
    """One row a policy, in float32: quantiles over single calls, and the median per evaluation of a batch.

    For one core, run under `taskset -c 0`. `lula_franka` needs NVIDIA's files in `$JAXRMP_DATA/lula`.
    """
    policies = {"panda_24_pairs": panda_24_pairs, "learned_drawer": learned_drawer}
    if lula_folder().is_dir():
        policies["lula_franka"] = lula_franka
    return [_row(name, *make()) for name, make in policies.items()]


def panda_24_pairs() -> tuple[Any, Callable]:
    """A goal for the hand, 14 joint limits, and 6 robot spheres by 4 obstacle spheres."""
    robot = panda()
    hand = ControlPoints(robot, ("panda_hand",))
    spheres = ControlPoints(robot, (*(f"panda_link{i}" for i in range(3, 8)), "panda_hand"))
    obstacles = Spheres.of(
        [((0.45, 0.10, 0.55), 0.08), ((0.30, 0.30, 0.25), 0.08), ((0.60, -0.10, 0.40), 0.08), ((0, 0.50, 0.70), 0.08)]
    )
    distances = ObstacleDistances(spheres, World(spheres=obstacles), [0.1, 0.1, 0.1, 0.08, 0.08, 0.08])
    goal = Attractor(jnp.array([0.45, 0.35, 0.45]))
    tree = pullback(hand, Batched(goal, shared=True)) + pullback(distances, CollisionAvoidance())
    return tree + JointLimit(robot.lower, robot.upper) + Damping(), acceleration


def learned_drawer() -> tuple[Any, Callable]:
    """The skill of `configs/drawer_closing.toml`: three learned leaves, joint damping and joint limits."""
    configuration = load_configuration("configs/drawer_closing.toml")
    robot, demonstrations = robot_of(configuration), find_demonstrations(default_demonstrations("drawer_closing"))
    return learn(configuration, robot, demonstrations).skill.tree(robot), acceleration


def lula_franka() -> tuple[Any, Callable]:
    """NVIDIA's policy for the Franka in the scene of their published test vector."""
    golden = json.loads((lula_folder() / "golden_franka.json").read_text())
    policy = load_lula(*(lula_folder() / golden[name] for name in ("urdf", "xrdf", "config")))
    spheres, boxes = [], []
    for obstacle in golden["obstacles"]:
        if obstacle["type"] == "sphere":
            spheres.append((obstacle["center"], obstacle["radius"]))
        else:
            T = np.eye(4)
            T[:3, 3] = obstacle["center"]
            boxes.append((T, np.array(obstacle["side_lengths"]) / 2))
    tree = policy.tree(
        frame=golden["frame"],
        position_target=jnp.array(golden["position_target"]),
        cspace_target=jnp.array(golden["cspace_attractor"]),
        world=World(spheres=Spheres.of(spheres), boxes=Boxes.of(boxes)),
    )
    return (policy, tree), lambda both, q, qd: both[0].acceleration(both[1], q, qd)


def lula_folder() -> Path:
    """Where NVIDIA's files are, if they are."""
    return Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "lula"


def _row(name: str, tree: Any, evaluate: Callable) -> dict[str, Any]:
    tree = jax.tree.map(jnp.asarray, tree)
    rng = np.random.default_rng(0)
    Q = jnp.asarray(POSTURE + 0.2 * rng.normal(size=(BATCH, 7)), jnp.float32)
    QD = jnp.asarray(0.1 * rng.normal(size=(BATCH, 7)), jnp.float32)
    start = time.perf_counter()
    one = jax.jit(evaluate)
    one(tree, Q[0], QD[0]).block_until_ready()
    compile_s = time.perf_counter() - start
    many = jax.jit(jax.vmap(evaluate, in_axes=(None, 0, 0)))
    q, qd = Q[0], QD[0]
    call_us = _microseconds(lambda: one(tree, q, qd), CALLS)
    batch_us = _microseconds(lambda: many(tree, Q, QD), BATCH_CALLS) / BATCH
    return {
        "name": name,
        **{f"{label}_us": float(np.quantile(call_us, p)) for label, p in QUANTILES.items()},
        "batch_1024_us": float(np.median(batch_us)),
        "compile_s": compile_s,
    }


def _microseconds(call: Callable, count: int) -> np.ndarray:
    taken = np.empty(count)
    for i in range(-(count // 10), count):  # a tenth to warm up, whose entries are written over
        start = time.perf_counter_ns()
        call().block_until_ready()
        taken[i] = (time.perf_counter_ns() - start) / 1e3
    return taken
