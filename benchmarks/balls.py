"""Balls on the way: the share of rollouts that get past a ball put on a demonstrated path of the hand.

Each task's skill is learned as `jaxrmp learn` does, and its whole arm rolled out kinematically from where each
demonstration began: at steps of 2 ms, for 20 s. Balls are 6 cm across. Their centres are seeded: on the demonstrated
path of the first control point at a share of its length from 0.25 to 0.75, then off it by up to the ball's radius,
uniformly within a ball of that size. A ball is drawn anew that leaves the arm less than 1 cm at the start, or where the
same rollout ends without a ball: from there no policy could start, or end. Arrived is a rollout whose control points
all end within 1 cm of the skill's targets. Touched is a ball that a sphere of the arm's cover came into.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import policies, uncertified_leaves
from jaxrmp.cli._sources import default_demonstrations, find_demonstrations
from jaxrmp.kinematics import Robot
from jaxrmp.learning import (
    PreparedDemonstrations,
    Skill,
    control_points,
    in_frame,
    learn,
    load_configuration,
    reproduction_errors,
)
from jaxrmp.policies import ArmPolicy
from jaxrmp.simulation import rollout
from jaxrmp.world import ObstacleDistances, RobotSpheres, SelfDistances, Spheres, World, own_self_pairs, own_spheres

COUNT, SEED, RADIUS = 20, 0, 0.03  # a demonstration; m
SHARES, CLEAR, NEAR = (0.25, 0.75), 0.01, 0.01  # of the path; m at the start and the end; m to have arrived
DURATION, DT, SUBSTEPS = 20.0, 0.01, 5  # s, s, steps of the policy in one that is looked at
TASKS = {"drawer_closing": "drawer_closing", "door_reaching": "door_reaching", "cup_round": "drawer_closing"}


class Passed(NamedTuple):
    """Of each rollout: least distances to balls and to itself, m, where it ended [n], its largest rise of energy in a
    step as a share of the energy's range, and whether all was finite."""

    obstacle: jax.Array
    own: jax.Array
    end: jax.Array
    rise: jax.Array
    finite: jax.Array


class Problem(NamedTuple):
    """A skill with its whole-arm policy, and each demonstration's start [N, n] and object [N, 4, 4]."""

    skill: Skill
    robot: Robot
    policy: ArmPolicy
    prepared: PreparedDemonstrations
    starts: np.ndarray
    poses: np.ndarray


def problem(task: str, configuration: str) -> Problem:
    """The skill of a task, learned from its demonstrations with seed 0 by a committed configuration."""
    settings = replace(load_configuration(f"configs/{configuration}.toml"), name=task, seed=0)
    robot = settings.load_robot()
    learning = learn(settings, robot, find_demonstrations(default_demonstrations(task)))
    policy = policies.whole_arm_policy(learning.skill, robot)
    starts = np.stack([q[0] for q in learning.prepared.joints.q]).astype(np.float32)
    poses = np.stack(learning.prepared.poses).astype(np.float32)
    return Problem(learning.skill, robot, policy, learning.prepared, starts, poses)


def path_of(case: Problem, i: int) -> np.ndarray:
    """Where the first control point was in demonstration i [T, 3], m, in the robot's world."""
    return control_points(case.robot, case.skill.frames, case.skill.offsets, case.prepared.joints.q[i])[:, 0]


def place(rng: np.random.Generator, path: np.ndarray) -> np.ndarray:
    """A ball's centre [3], m, on a path [T, 3] or near it."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    at = rng.uniform(*SHARES) * along[-1]
    on = np.array([np.interp(at, along, path[:, k]) for k in range(3)])
    aside = rng.normal(size=3)
    return on + RADIUS * rng.uniform() ** (1 / 3) * aside / np.linalg.norm(aside)


def gap(case: Problem, q: np.ndarray, center: np.ndarray) -> float:
    """The least distance of the arm at `q` [n] to a ball, m."""
    moving = case.policy.spheres
    points = np.asarray(moving.points(case.robot)(jnp.asarray(q, jnp.float32)))
    return float((np.linalg.norm(points - center, axis=1) - moving.radii).min() - RADIUS)


def balls_of(case: Problem, ends: np.ndarray) -> tuple[np.ndarray, int]:
    """Centres [N, COUNT, 3], m, and how many were drawn anew; `ends` [N, n], of rollouts without balls."""
    rng, centers, anew = np.random.default_rng(SEED), [], 0
    for i, end in enumerate(ends):
        path, own = path_of(case, i), []
        while len(own) < COUNT:
            center = place(rng, path)
            clear = min(gap(case, case.starts[i], center), gap(case, end, center)) >= CLEAR
            own.append(center) if clear else None
            anew += not clear
        centers.append(own)
    return np.array(centers, np.float32), anew


@partial(jax.jit, static_argnames=("pairs",))
def passed(policy: ArmPolicy, starts, poses, centers, active, spheres: RobotSpheres, pairs) -> Passed:
    """What becomes of rollouts from `starts` [B, n] with the object at `poses` [B, 4, 4] and a ball at `centers`.

    `spheres` and their `pairs`: what of the arm must not meet itself.
    """

    def one(q, T, center, active):
        world = World(spheres=Spheres(center[None], jnp.full(1, RADIUS, q.dtype), active[None]))
        path = rollout(policy.tree(T, world), q, duration=DURATION, dt=DT, substeps=SUBSTEPS)
        outer = ObstacleDistances(policy.spheres.points(policy.robot), world, policy.spheres.radii)
        own = SelfDistances(spheres.points(policy.robot), pairs, spheres.radii)
        least = [jax.lax.map(lambda q, of=of: of(q).min(), path.q).min() for of in (outer, own)]
        span = path.energy.max() - path.energy.min()
        rise = jnp.maximum(jnp.diff(path.energy).max(), 0) / span
        return Passed(*least, path.q[-1], rise, jnp.isfinite(path.q).all())

    return jax.vmap(one)(starts, poses, centers, active)


def world_of(center: np.ndarray) -> World:
    """One ball."""
    return World(spheres=Spheres.of([(center, RADIUS)]))


def row(name: str, case: Problem) -> dict[str, Any]:
    """What becomes of the balls of one task."""
    robot, policy, N = case.robot, case.policy, len(case.starts)
    spheres = own_spheres(robot)
    look = partial(passed, policy, spheres=spheres, pairs=own_self_pairs(robot, spheres))
    free = look(case.starts, case.poses, np.zeros((N, 3), np.float32), np.zeros(N, bool))
    centers, anew = balls_of(case, np.asarray(free.end))
    many = (np.repeat(case.starts, COUNT, 0), np.repeat(case.poses, COUNT, 0), centers.reshape(-1, 3))
    found = jax.tree.map(np.asarray, look(*many, np.ones(N * COUNT, bool)))
    left = distance_left(case, found.end, many[1])
    arrived, touched = left < NEAR, found.obstacle < 0
    return {
        "name": name,
        "balls": len(left),
        "drawn_anew": anew,
        "arrive_without": int((distance_left(case, np.asarray(free.end), case.poses) < NEAR).sum()),
        "arrived": int(arrived.sum()),
        "arrived_percent": 100 * float(arrived.mean()),
        "touched": int(touched.sum()),
        "least_mm": 1e3 * float(found.obstacle.min()),
        "least_self_mm": 1e3 * float(found.own.min()),
        "energy_increase": float(found.rise.max()),
        "others_left_cm": [round(100 * float(d), 1) for d in np.sort(left[~arrived])],
        "not_finite": int((~found.finite).sum()),
        "uncertified": list(uncertified_leaves(policy.tree(case.poses[0], world_of(centers[0, 0])))),
    }


def distance_left(case: Problem, q: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """How far the control points are from the skill's targets at postures [B, n], the farthest of each, m, [B]."""
    offsets, targets = np.asarray(case.skill.offsets, float), np.asarray(case.skill.targets)
    ends = (control_points(case.robot, case.skill.frames, offsets, at[None]) for at in q)
    return np.array([np.linalg.norm(in_frame(p, T)[0] - targets, axis=1).max() for p, T in zip(ends, poses, strict=True)])


def rows() -> list[dict[str, Any]]:
    """One row a task whose demonstrations are there."""
    return [row(name, problem(name, configuration)) for name, configuration in TASKS.items()]
