"""A control loop in which everything moves: the goal, the object's pose and the obstacles; nothing compiles again."""

import time
from typing import Any

import jax
import numpy as np

from jaxrmp import Batched, Node, acceleration, pullback
from jaxrmp.cli._sources import robot_of
from jaxrmp.kinematics import ControlPoints, Robot, panda
from jaxrmp.learning import Skill, load_skill
from jaxrmp.leaves import Attractor, CollisionAvoidance
from jaxrmp.world import ObstacleDistances, Spheres, World

from ._policies import GOAL, OBSTACLES, POSTURE, SPHERES
from ._skills import skill_file
from ._timing import quantiles

STEPS, DT = 10_000, 1e-3


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One row: how often the policy was traced after the first step, and what a step takes.

    A step builds the tree anew, as a loop that reads a tracker would: where the door is, the goal and the obstacles.
    """
    skill = load_skill(skill_file("drawer_closing" if quick else "door_reaching", quick=quick))
    found = run(skill, robot_of(skill.configuration), 100 if quick else STEPS)
    return [{"name": "moving_goal_door_obstacles", **found}]


def run(skill: Skill, robot: Robot, steps: int) -> dict[str, Any]:
    """The columns of `rows` for a loop of `steps` steps of a millisecond."""
    traces: list[int] = []

    @jax.jit
    def policy(tree, q, qd):
        traces.append(1)
        return acceleration(tree, q, qd)

    q, qd = np.array(POSTURE, np.float32), np.zeros(7, np.float32)
    begun, taken, first = np.asarray(skill.T_world_object, float), np.empty(steps), 0
    for step in range(steps):
        start = time.perf_counter_ns()
        tree = moving_tree(skill, robot, begun, step * DT)
        qdd = np.asarray(policy(tree, q, qd))
        qd = qd + np.float32(DT) * qdd
        q = q + np.float32(DT) * qd
        taken[step] = (time.perf_counter_ns() - start) / 1e3
        first = first or len(traces)
    if not np.isfinite(q).all():
        raise RuntimeError("the control loop's arm left the finite numbers.")
    return {"steps": steps, "retraces": len(traces) - first, **quantiles(taken[1:])}


def moving_tree(skill: Skill, robot: Robot, T_world_object: np.ndarray, t: float) -> Node:
    """The skill, a goal for the hand and 24 pairs of spheres, all where they are after `t` seconds."""
    T = T_world_object.copy()
    T[:3, 3] += 0.05 * np.sin([t, 1.3 * t, 0.7 * t])
    goal = np.array(GOAL) + 0.05 * np.cos([t, 0.9 * t, 1.1 * t])
    shift = 0.05 * np.sin([1.7 * t, t, 0.6 * t])
    obstacles = Spheres.of([(np.array(center) + shift, radius) for center, radius in OBSTACLES])
    distances = ObstacleDistances(
        ControlPoints(panda(), tuple(SPHERES)), World(spheres=obstacles), list(SPHERES.values())
    )
    attractor = Batched(Attractor(goal), shared=True)
    return (
        skill.tree(robot, T)
        + pullback(ControlPoints(robot, ("panda_hand",)), attractor)
        + pullback(distances, CollisionAvoidance())
    )
