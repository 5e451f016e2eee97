"""Arms of other people: loaded, covered, and taken to random poses among obstacles, all by the same gains.

The robots are of the package example-robot-data; `make robots` puts it where this looks, or JAXRMP_ROBOTS says where
its folder `robots` is. Each arm, both arms at once where there are two, starts at a rest posture of `find_rest` among
four obstacles clear of that. Goals are poses of the hands at random postures clear of the robot and of the obstacles,
in position alone for arms of five joints. The policy is told the poses alone: `find_posture` finds postures for them.
Rollouts are kinematic and last 10 s at 1 kHz. Times are CPU seconds; those of the cover and its pairs count where
JAXRMP_CACHE is an empty folder.
"""

import os
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import acceleration, policies
from jaxrmp.kinematics import Robot, forward_kinematics, hand_frame, idle_joints, load_robot
from jaxrmp.world import (
    Boxes,
    ObstacleDistances,
    RobotSpheres,
    SelfDistances,
    Spheres,
    World,
    own_self_pairs,
    own_spheres,
)

GOALS, SEED = 50, 0
DURATION, DT, EVERY = 10.0, 1e-3, 5  # s, s, steps from one look at distances to the next
NEAR, TURNED = 0.01, np.deg2rad(5)  # m, rad: what counts as reached
# m, how far postures are from obstacles, and spheres from each other, at least.
CLEAR, APART = 0.03, 0.005
FOLDER = Path(os.environ.get("JAXRMP_ROBOTS") or ".robots/cmeel.prefix/share/example-robot-data/robots")


class Arm(NamedTuple):
    """A file of the package, hands (none: the one that is found), and whether goals have a turn."""

    file: str
    hands: tuple[str, ...] = ()
    turned: bool = True


ROBOTS = {
    "UR5": Arm("ur_description/urdf/ur5_robot.urdf"),
    "UR10": Arm("ur_description/urdf/ur10_robot.urdf"),
    "xArm7": Arm("xarm_description/urdf/xarm7.urdf"),
    "Kinova": Arm("kinova_description/robots/kinova.urdf"),
    "Z1": Arm("z1_description/urdf/z1.urdf"),
    "SO-101": Arm("so_arm_description/urdf/so101.urdf", turned=False),
    "Tiago": Arm("tiago_description/robots/tiago.urdf"),
    "Tiago Dual": Arm(
        "tiago_description/robots/tiago_dual.urdf", ("hand_left_grasping_frame", "hand_right_grasping_frame")
    ),
    "Baxter": Arm("baxter_description/urdf/baxter.urdf", ("left_gripper", "right_gripper")),
    "Talos": Arm("talos_data/robots/talos_reduced.urdf", ("gripper_left_base_link", "gripper_right_base_link")),
    "G1": Arm("g1_description/urdf/g1_29dof_rev_1_0.urdf", ("left_rubber_hand", "right_rubber_hand")),
}


class Reached(NamedTuple):
    """Of a rollout: least distances to obstacles and to itself, m; least margin to a limit, rad or m; how far the worst
    hand is from its goal in the end, m and rad; whether all was finite."""

    obstacle: jax.Array
    own: jax.Array
    margin: jax.Array
    goal: jax.Array
    turn: jax.Array
    finite: jax.Array


def loaded(arm: Arm) -> tuple[Robot, tuple[str, ...]]:
    """The robot, the joints that move no hand locked, and its hands."""
    whole = load_robot(FOLDER / arm.file)
    hands = arm.hands or (hand_frame(whole),)
    idle = set.intersection(*(set(idle_joints(whole, hand)) for hand in hands))
    return load_robot(FOLDER / arm.file, fixed=dict.fromkeys(sorted(idle))), hands


def distances(robot: Robot, spheres: RobotSpheres, pairs: Any, world: World) -> Any:
    """From joint positions to the least distances of the robot to the world and to itself, m."""
    moving = spheres.moving(robot)
    outer = ObstacleDistances(moving.points(robot), world, moving.radii)
    own = SelfDistances(spheres.points(robot), pairs, spheres.radii) if pairs else None

    def least(q):
        return outer(q).min(), own(q).min() if own else jnp.asarray(jnp.inf, q.dtype)

    return least


def postures(rng: np.random.Generator, robot: Robot, count: int) -> np.ndarray:
    """Random ones within the limits, turns of more than pi aside, [count, n]."""
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    margin = 0.08 * (high - low)
    return rng.uniform(low + margin, high - margin, (count, robot.num_joints)).astype(np.float32)


def obstacles(rng: np.random.Generator, robot: Robot, spheres: RobotSpheres, rest: np.ndarray, reach: float) -> World:
    """Two spheres and two boxes, clear of the rest posture and of the robot's first metre above its base."""
    moving = spheres.moving(robot)
    at = np.asarray(moving.points(robot)(jnp.asarray(rest)))
    middle = at.mean(0)
    placed: list[tuple[np.ndarray, np.ndarray]] = []
    while len(placed) < 4:
        center = middle + reach * rng.uniform(-0.9, 0.9, 3)
        half = reach * rng.uniform(0.05, 0.12, 3)
        if (np.linalg.norm(at - center, axis=1) - moving.radii - np.linalg.norm(half)).min() > 0.05:
            placed.append((center, half))
    pose = [np.block([[np.eye(3), c[:, None]], [np.zeros(3), 1.0]]) for c, _ in placed]
    balls = Spheres.of([(c, float(h[0])) for c, h in placed[:2]])
    return World(spheres=balls, boxes=Boxes.of([(T, h) for T, (_, h) in zip(pose[2:], placed[2:], strict=True)]))


@partial(jax.jit, static_argnames=("turned", "steps"))
def outcomes(policy, world, rest, goals, postures, least, turned, steps):
    """What becomes of each of `goals` [G, H, 4, 4] from `rest`, drawn to `postures` [G, n]."""
    robot, hands = policy.robot, tuple(task.frame for task in policy.tasks)

    def one(goal, posture):
        tree = policies.guided(policy, posture).tree(goal, world)

        def look(q, seen):
            outer, own = least(q)
            T = jnp.stack([forward_kinematics(robot, q, hand) for hand in hands])
            R = jnp.einsum("hki,hkj->hij", T[:, :3, :3], goal[:, :3, :3], precision="highest")
            turn = jnp.arccos(jnp.clip((jnp.trace(R, axis1=1, axis2=2) - 1) / 2, -1, 1))
            return Reached(
                jnp.minimum(seen.obstacle, outer),
                jnp.minimum(seen.own, own),
                jnp.minimum(seen.margin, jnp.minimum(q - robot.lower, robot.upper - q).min()),
                jnp.linalg.norm(T[:, :3, 3] - goal[:, :3, 3], axis=1).max(),
                turn.max() if turned else jnp.zeros((), q.dtype),
                seen.finite & jnp.isfinite(q).all(),
            )

        def step(_, state):
            q, qd = state
            qd = qd + DT * acceleration(tree, q, qd)
            return q + DT * qd, qd

        def steps_and_look(state, _):
            q, qd, seen = state
            q, qd = jax.lax.fori_loop(0, EVERY, step, (q, qd))
            return (q, qd, look(q, seen)), None

        far, none = jnp.full((), jnp.inf, rest.dtype), jnp.zeros((), rest.dtype)
        start = rest, jnp.zeros_like(rest), Reached(far, far, far, far, none, jnp.asarray(True))
        return jax.lax.scan(steps_and_look, start, length=steps // EVERY)[0][2]

    return jax.vmap(one)(goals, postures)


def row(name: str, arm: Arm) -> dict[str, Any]:
    """One robot: how long loading and covering take, and what becomes of its goals."""
    rng = np.random.default_rng([SEED, sorted(ROBOTS).index(name)])
    begun = time.process_time()
    robot, hands = loaded(arm)
    found: dict[str, Any] = {"name": name, "joints": robot.num_joints, "load_s": time.process_time() - begun}
    begun = time.process_time()
    spheres = own_spheres(robot)
    found |= {"spheres": spheres.size, "cover_s": time.process_time() - begun}
    begun = time.process_time()
    pairs = own_self_pairs(robot, spheres)
    found |= {"error_mm": 1e3 * spheres.coverage_error, "pairs": len(pairs), "pairs_s": time.process_time() - begun}
    rest = policies.find_rest(robot, hands, spheres, pairs, seed=rng).astype(np.float32)
    q = postures(rng, robot, 20000)
    places = jax.jit(jax.vmap(lambda q: jnp.stack([forward_kinematics(robot, q, hand) for hand in hands])))(q)
    reach = float(np.ptp(np.asarray(places)[:, 0, :3, 3], axis=0).max() / 2)
    world = obstacles(rng, robot, spheres, rest, reach)
    least = jax.tree_util.Partial(distances(robot, spheres, pairs, world))
    outer, own = map(np.asarray, jax.jit(jax.vmap(least))(q))
    clear = (outer > CLEAR) & (own > APART)
    goals = np.asarray(places)[clear][:GOALS]
    policy = policies.reaching_policy(robot, hands, rest, spheres)
    if not arm.turned:
        policy = replace(policy, tasks=tuple(replace(task, orientation=None) for task in policy.tasks))
    numbers = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (rest, goals))
    find = jax.jit(
        jax.vmap(lambda T: policies.find_posture(robot, hands, T, numbers[0], spheres, world, turned=arm.turned))
    )
    begun = time.perf_counter()
    posture = jax.block_until_ready(find(numbers[1])).q
    found |= {"goals": len(goals), "search_s": time.perf_counter() - begun}
    begun = time.perf_counter()
    result = outcomes(policy, world, *numbers, posture, least, arm.turned, round(DURATION / DT))
    result = jax.tree.map(np.asarray, result)
    found["roll_out_s"] = time.perf_counter() - begun
    return found | {
        "reached": int(((result.goal < NEAR) & (result.turn < TURNED)).sum()),
        "penetrations": int(((result.obstacle < 0) | (result.own < 0)).sum()),
        "least_obstacle_mm": 1e3 * float(result.obstacle.min()),
        "least_self_mm": 1e3 * float(result.own.min()),
        "limits_crossed": int((result.margin < 0).sum()),
        "least_margin": float(result.margin.min()),
        "not_finite": int((~result.finite).sum()),
    }


def of_each(arms: dict[str, Any], row: Callable[[str, Any], dict[str, Any]]) -> list[dict[str, Any]]:
    """The `row` of each of the `arms` by its name, told as it comes."""
    if not FOLDER.is_dir():
        raise SystemExit(f"there is no folder {FOLDER}: run `make robots`, or set JAXRMP_ROBOTS.")
    found = []
    for name, arm in arms.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found.append(row(name, arm))
        print(found[-1], file=sys.stderr, flush=True)
    return found


def rows() -> list[dict[str, Any]]:
    """One row a robot."""
    return of_each(ROBOTS, row)
