"""A control loop in which everything moves: the goal, the door's pose and the obstacles; nothing compiles again."""

import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxrmp import Batched, Node, RigidTransform, acceleration, compose, pullback
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.learning import load_skill
from jaxrmp.leaves import Attractor, CollisionAvoidance, Damping, JointLimit
from jaxrmp.world import ObstacleDistances, Spheres, World

from ._policies import GOAL, OBSTACLES, POSTURE, SPHERES
from ._skills import skill_file
from ._timing import quantiles

STEPS, DT = 10_000, 1e-3


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One row a policy: how often it was traced after the first step, and what a step takes.

    A step builds the tree anew from NumPy arrays, as a loop that reads a tracker would.
    """
    steps = 100 if quick else STEPS
    found = [{"name": "moving_goal_door_obstacles", **run(moving_scene, steps)}]
    if not quick:
        found.append({"name": "learned_door_that_moves", **run(moving_skill(), steps)})
    return found


def run(tree_at: Callable[[float], Node], steps: int) -> dict[str, Any]:
    """The columns of `rows` for a loop of `steps` steps of a millisecond with the tree `tree_at(seconds)`."""
    traces: list[int] = []

    @jax.jit
    def policy(tree, q, qd):
        traces.append(1)
        return acceleration(tree, q, qd)

    q, qd = np.array(POSTURE, np.float32), np.zeros(7, np.float32)
    taken, first = np.empty(steps), 0
    for step in range(steps):
        start = time.perf_counter_ns()
        qdd = np.asarray(policy(tree_at(step * DT), q, qd))
        qd = qd + np.float32(DT) * qdd
        q = q + np.float32(DT) * qd
        taken[step] = (time.perf_counter_ns() - start) / 1e3
        first = first or len(traces)
    if not np.isfinite(q).all():
        raise RuntimeError("the control loop's arm left the finite numbers.")
    return {"steps": steps, "retraces": len(traces) - first, **quantiles(taken[1:])}


def moving_scene(t: float) -> Node:
    """The scene of 24 pairs after `t` seconds: its goal lies in the frame of a door, and all of them move."""
    robot = panda()
    T_world_door = moved(np.eye(4), t)
    goal = np.array(GOAL) + 0.05 * np.cos([t, 0.9 * t, 1.1 * t])
    shift = 0.05 * np.sin([1.7 * t, t, 0.6 * t])
    obstacles = Spheres.of([(np.array(center) + shift, radius) for center, radius in OBSTACLES])
    points = ControlPoints(robot, tuple(SPHERES))
    distances = ObstacleDistances(points, World(spheres=obstacles), list(SPHERES.values()))
    seen = compose(ControlPoints(robot, ("panda_hand",)), RigidTransform(T_world_door))
    tree = pullback(seen, Batched(Attractor(goal), shared=True)) + pullback(
        distances, CollisionAvoidance(0.2, 1e-5, 0.0, 0.07, 0.5, frequency=float("inf"))
    )
    return tree + JointLimit(robot.lower, robot.upper) + Damping(1.0, 5.0)


def moving_skill() -> Callable[[float], Node]:
    """The learned door skill, whose door moves."""
    skill = load_skill(skill_file("door_reaching"))
    robot, first = skill.load_robot(), np.asarray(skill.T_world_object, float)
    return lambda t: skill.tree(robot, moved(first, t))


def moved(T: np.ndarray, t: float) -> np.ndarray:
    """A pose that sways by 5 cm and 0.1 rad about the vertical."""
    angle = 0.1 * np.sin(0.8 * t)
    sway = np.eye(4)
    sway[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    sway[:3, 3] = 0.05 * np.sin([t, 1.3 * t, 0.7 * t])
    return T @ sway
