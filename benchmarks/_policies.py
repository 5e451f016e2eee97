"""The policies that are measured."""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import Batched, Node, acceleration, pullback
from jaxrmp._pytree import single
from jaxrmp.io import load_lula
from jaxrmp.kinematics import ControlPoints, Robot, panda
from jaxrmp.learning import load_skill
from jaxrmp.learning._configuration import Method
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


@dataclass(frozen=True, eq=False)
class Policy:
    """A policy as a control loop has it: `moving`, what may be another at every call, as NumPy arrays; `tree_of`, the
    tree for that; and `resolved`, the acceleration for a tree, q and qd. All that does not move is compiled in."""

    moving: Any
    tree_of: Callable[[Any], Any]
    resolved: Callable[[Any, jax.Array, jax.Array], jax.Array] = acceleration

    def __call__(self, moving: Any, q: jax.Array, qd: jax.Array) -> jax.Array:
        return self.resolved(self.tree_of(moving), q, qd)


def policies(quick: bool) -> dict[str, Policy]:
    """All that can be had here, or the first if `quick`; `lula_franka` needs NVIDIA's files in `$JAXRMP_DATA/lula`."""
    found = {"panda_24_pairs": panda_24_pairs()}
    if quick:
        return found
    found["learned_drawer"] = learned_drawer()
    found["flow_drawer"] = learned_drawer(method="flow")
    if lula_folder().is_dir():
        found["lula_franka"] = lula_franka()
    return found


def policy_named(name: str) -> Policy:
    """One of the policies by its name."""
    return {"panda_24_pairs": panda_24_pairs, "learned_drawer": learned_drawer, "lula_franka": lula_franka}[name]()


def panda_24_pairs() -> Policy:
    """A goal for the hand, 14 joint limits, and 6 robot spheres by 4 obstacle spheres: the scene of all comparisons.

    Goal and obstacles may move.
    """
    robot = panda()

    def tree_of(moving):
        goal, obstacles = moving
        return among_spheres(robot, ("panda_hand",), tuple(SPHERES), list(SPHERES.values()), obstacles, goal)

    return Policy(single((np.array(GOAL), Spheres.of(OBSTACLES))), tree_of)


def among_spheres(
    robot: Robot, hands: tuple[str, ...], frames: tuple[str, ...], radii: Any, obstacles: Spheres, goal: Any = GOAL
) -> Node:
    """One goal for some frames, joint limits, damping, and spheres at some frames that keep off obstacles."""
    distances = ObstacleDistances(ControlPoints(robot, frames), World(spheres=obstacles), radii)
    goal = Batched(Attractor(jnp.asarray(goal)), shared=True)
    tree = pullback(ControlPoints(robot, hands), goal) + pullback(
        distances, CollisionAvoidance(0.2, 1e-5, 0.0, 0.07, 0.5, frequency=float("inf"))
    )
    return tree + JointLimit(robot.lower, robot.upper) + Damping()


def learned_drawer(quick: bool = False, method: Method = "paper") -> Policy:
    """The skill of `configs/drawer_closing.toml`: learned leaves, damping, limits; the drawer may move."""
    skill = load_skill(skill_file("drawer_closing", quick=quick, method=method))
    robot = skill.load_robot()
    return Policy(single(np.asarray(skill.T_world_object)), lambda T: skill.tree(robot, T))


def lula_franka() -> Policy:
    """NVIDIA's policy for the Franka in the scene of their published test vector; targets and obstacles may move."""
    golden = json.loads((lula_folder() / "golden_franka.json").read_text())
    loaded = load_lula(*(lula_folder() / golden[name] for name in ("urdf", "xrdf", "config")))

    def tree_of(moving):
        position, posture, world = moving
        return loaded.tree(frame=golden["frame"], position_target=position, cspace_target=posture, world=world)

    targets = (np.array(golden["position_target"]), np.array(golden["cspace_attractor"]))
    return Policy(single((*targets, world_of(golden))), tree_of, loaded.acceleration)


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


def on_device(tree: Any) -> Any:
    """The same tree with its arrays on the device, in JAX's precision."""
    return jax.tree.map(jnp.asarray, tree)


def states(count: int, n: int = 7, posture: Any = POSTURE) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions and velocities [count, n] around a posture, float32, as a robot's driver would hand them over."""
    rng = np.random.default_rng(0)
    q = np.asarray(posture) + 0.2 * rng.normal(size=(count, n))
    return q.astype(np.float32), (0.1 * rng.normal(size=(count, n))).astype(np.float32)
