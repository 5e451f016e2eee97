"""The policies that are measured: pairs of a tree and the function of tree, q and qd that gives the acceleration."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import Batched, Node, acceleration, pullback
from jaxrmp.cli._sources import robot_of
from jaxrmp.io import load_lula
from jaxrmp.kinematics import ControlPoints, Robot, panda
from jaxrmp.learning import load_skill
from jaxrmp.leaves import Attractor, CollisionAvoidance, Damping, JointLimit
from jaxrmp.world import Boxes, ObstacleDistances, Spheres, World

from ._skills import skill_file

POSTURE = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
GOAL = (0.45, 0.35, 0.45)
SPHERES = {**{f"panda_link{i}": 0.1 for i in (3, 4, 5)}, **{f"panda_link{i}": 0.08 for i in (6, 7)}, "panda_hand": 0.08}
OBSTACLES = [
    ((0.45, 0.10, 0.55), 0.08),
    ((0.30, 0.30, 0.25), 0.08),
    ((0.60, -0.10, 0.40), 0.08),
    ((0.0, 0.50, 0.70), 0.08),
]


def policies(quick: bool) -> dict[str, tuple[Any, Callable]]:
    """All that can be had here, or the first if `quick`; `lula_franka` needs NVIDIA's files in `$JAXRMP_DATA/lula`."""
    found = {"panda_24_pairs": panda_24_pairs()}
    if quick:
        return found
    found["learned_drawer"] = learned_drawer()
    if lula_folder().is_dir():
        found["lula_franka"] = lula_franka()
    return found


def policy(name: str) -> tuple[Any, Callable]:
    """One of them by its name."""
    return {"panda_24_pairs": panda_24_pairs, "learned_drawer": learned_drawer, "lula_franka": lula_franka}[name]()


def panda_24_pairs() -> tuple[Any, Callable]:
    """A goal for the hand, 14 joint limits, and 6 robot spheres by 4 obstacle spheres: the scene of all comparisons."""
    robot = panda()
    tree = among_spheres(robot, "panda_hand", tuple(SPHERES), list(SPHERES.values()), Spheres.of(OBSTACLES))
    return as_arrays(tree), acceleration


def among_spheres(robot: Robot, hand: str, frames: tuple[str, ...], radii: Any, obstacles: Spheres) -> Node:
    """A goal for one frame, joint limits, damping, and spheres at some frames that keep off obstacles."""
    distances = ObstacleDistances(ControlPoints(robot, frames), World(spheres=obstacles), radii)
    goal = Batched(Attractor(jnp.array(GOAL)), shared=True)
    tree = pullback(ControlPoints(robot, (hand,)), goal) + pullback(distances, CollisionAvoidance())
    return tree + JointLimit(robot.lower, robot.upper) + Damping()


def learned_drawer(quick: bool = False) -> tuple[Any, Callable]:
    """The skill of `configs/drawer_closing.toml`: three learned leaves, joint damping and joint limits."""
    skill = load_skill(skill_file("drawer_closing", quick=quick))
    return as_arrays(skill.tree(robot_of(skill.configuration))), acceleration


def lula_franka() -> tuple[Any, Callable]:
    """NVIDIA's policy for the Franka in the scene of their published test vector."""
    golden = json.loads((lula_folder() / "golden_franka.json").read_text())
    policy = load_lula(*(lula_folder() / golden[name] for name in ("urdf", "xrdf", "config")))
    tree = policy.tree(
        frame=golden["frame"],
        position_target=jnp.array(golden["position_target"]),
        cspace_target=jnp.array(golden["cspace_attractor"]),
        world=world_of(golden),
    )
    return as_arrays((policy, tree)), lambda both, q, qd: both[0].acceleration(both[1], q, qd)


def world_of(golden: dict[str, Any], free: int = 0) -> World:
    """The spheres and boxes of a published test vector, with as many slots of each left `free`."""
    spheres, boxes = [], []
    for obstacle in golden["obstacles"]:
        if obstacle["type"] == "sphere":
            spheres.append((obstacle["center"], obstacle["radius"]))
        else:
            T = np.eye(4)
            T[:3, 3] = obstacle["center"]
            boxes.append((T, np.array(obstacle["side_lengths"]) / 2))
    return World(
        spheres=Spheres.of(spheres, capacity=len(spheres) + free), boxes=Boxes.of(boxes, capacity=len(boxes) + free)
    )


def lula_folder() -> Path:
    """Where NVIDIA's files are, if they are."""
    return Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "lula"


def as_arrays(tree: Any) -> Any:
    """The same tree with its parameters on the device, in JAX's precision."""
    return jax.tree.map(jnp.asarray, tree)


def states(count: int, n: int = 7, posture: Any = POSTURE) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions and velocities [count, n] around a posture, float32, as a robot's driver would hand them over."""
    rng = np.random.default_rng(0)
    q = np.asarray(posture) + 0.2 * rng.normal(size=(count, n))
    return q.astype(np.float32), (0.1 * rng.normal(size=(count, n))).astype(np.float32)
