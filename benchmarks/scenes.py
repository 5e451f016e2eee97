"""The Panda with every leaf among random obstacles of all kinds: what it touches, what it reaches.

Goals are where random postures, free of collision with themselves and the floor, put the point between the fingertips.
Scenes are drawn without regard to the goals. Each rollout starts from the ready posture, is kinematic and lasts 10 s at
1 kHz. Distances count from spheres that cover the arm and stick out of its geometry by up to 1.4 cm.
"""

import sys
import time
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import acceleration, policies
from jaxrmp.kinematics import ControlPoints, Robot, panda
from jaxrmp.leaves import Attractor
from jaxrmp.policies import ArmPolicy
from jaxrmp.world import (
    Boxes,
    Capsules,
    Cylinders,
    HalfSpaces,
    ObstacleDistances,
    SelfDistances,
    SignedDistanceGrid,
    Spheres,
    World,
    panda_self_pairs,
    panda_spheres,
)

GOALS, SCENES, SEED = 200, 8, 0
DURATION, DT = 10.0, 1e-3
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
FREE = 0.10  # m, how far from every obstacle a goal must be for its reaching to count
NEAR = 0.01  # m, how near to its goal counts as reached
HAND = "panda_hand_tcp"


class Outcome(NamedTuple):
    """What a rollout did: least distances, m; largest share of a velocity limit; least margin to a joint limit, rad."""

    obstacle: jax.Array
    self_collision: jax.Array
    speed: jax.Array
    margin: jax.Array
    goal: jax.Array
    finite: jax.Array


def whole_arm(robot: Robot) -> ArmPolicy:
    """The reaching policy: one hand-designed leaf of each kind that an arm among obstacles needs, all certified.

    It leaves the hand's turn free, and is a little slower than for a goal that is dragged.
    """
    goal = Attractor(np.zeros(3), 5.0, 5.0, gain=3.0, sharpness=20.0, damping_rate=6.0)
    limits = policies.joint_limits(robot) + policies.velocity_limits(robot)
    rest = policies.posture(robot, READY, stiffness=0.1) + policies.damping(weight=0.05)
    return ArmPolicy(
        robot,
        (policies.HandGoal(np.eye(4), HAND, goal, None),),
        policies.self_avoidance(robot, panda_spheres(), panda_self_pairs()) + limits + rest,
        panda_spheres().moving(robot),
    )


def random_world(rng: np.random.Generator, robot: Robot) -> World:
    """A floor and three to seven more obstacles of all other kinds, clear of the ready posture and the base."""
    spheres = panda_spheres().moving(robot)
    at_ready = np.asarray(jax.jit(spheres.points(robot))(jnp.asarray(READY)))
    column = np.array([[0.0, 0.0, z] for z in np.arange(0.0, 0.5, 0.05)])
    guarded = np.concatenate([at_ready, column])
    clearance = np.concatenate([np.asarray(spheres.radii) + 0.06, np.full(len(column), 0.14)])
    kinds = ["sphere", "capsule", "box", "cylinder", "grid"]
    count = int(rng.integers(3, 8))
    wanted = list(rng.permutation(kinds))[: min(count, 5)]
    wanted += list(rng.choice(kinds[:4], count - len(wanted), replace=False))
    placed: dict[str, list] = {kind: [] for kind in kinds}
    distance = jax.jit(lambda world: jax.vmap(world.signed_distance)(jnp.asarray(guarded)).min(axis=1))
    for kind in wanted:
        while True:
            obstacle = _random_obstacle(rng, kind)
            world = _world({k: [obstacle] if k == kind else [] for k in kinds}, floor=False)
            if np.all(np.asarray(distance(world)) > clearance):
                placed[kind].append(obstacle)
                break
    return _world(placed, floor=True)


def _world(placed: dict[str, list], floor: bool) -> World:
    grid = placed["grid"][0] if placed["grid"] else _bowl(np.eye(4), active=False)
    world = World(
        spheres=Spheres.of(placed["sphere"], capacity=2),
        capsules=Capsules.of(placed["capsule"], capacity=2),
        boxes=Boxes.of(placed["box"], capacity=2),
        cylinders=Cylinders.of(placed["cylinder"], capacity=2),
        half_spaces=HalfSpaces.of([((0.0, 0.0, 1.0), -0.02)] if floor else [], capacity=1),
        grids=(grid,),
    )
    return jax.tree.map(lambda x: jnp.asarray(x, jnp.float32 if np.asarray(x).dtype != bool else bool), world)


def _random_obstacle(rng: np.random.Generator, kind: str) -> Any:
    angle, radius, height = rng.uniform(-np.pi, np.pi), rng.uniform(0.35, 0.85), rng.uniform(0.0, 0.9)
    center = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R * np.linalg.det(R), center
    match kind:
        case "sphere":
            return center, rng.uniform(0.04, 0.12)
        case "capsule":
            half = rng.uniform(0.05, 0.25) * T[:3, 0]
            return center - half, center + half, rng.uniform(0.02, 0.06)
        case "box":
            return T, rng.uniform(0.03, 0.15, 3)
        case "cylinder":
            return T, rng.uniform(0.03, 0.10), rng.uniform(0.05, 0.25)
        case _:
            return _bowl(T)


def _bowl(T: np.ndarray, active: bool = True) -> SignedDistanceGrid:
    """The lower half of a thick hollow ball, a shape that is not convex, sampled every 2 cm."""
    outer, inner, spacing = 0.11, 0.07, 0.02
    axis = np.arange(-0.18, 0.18 + 1e-9, spacing)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    rho, r = np.hypot(x, y), np.sqrt(x * x + y * y + z * z)
    middle, half = (outer + inner) / 2, (outer - inner) / 2
    below = np.abs(r - middle) - half
    rim = np.hypot(rho - middle, z) - half
    return SignedDistanceGrid(np.where(z <= 0, below, rim), np.full(3, axis[0]), spacing, T, active, smooth=False)


def random_goals(rng: np.random.Generator, robot: Robot, count: int) -> np.ndarray:
    """Points that the arm can reach, [count, 3], m."""
    spheres = panda_spheres()
    moving = spheres.moving(robot)
    floor = World(half_spaces=HalfSpaces.of([((0.0, 0.0, 1.0), -0.02)]))
    hand = ControlPoints(robot, HAND)

    @jax.jit
    @jax.vmap
    def look(q):
        own = SelfDistances(spheres.points(robot), panda_self_pairs(), spheres.radii)(q)
        ground = ObstacleDistances(moving.points(robot), floor, moving.radii)(q)
        return hand(q)[0], jnp.minimum(own.min(), ground.min())

    low, high = np.asarray(robot.lower) + 0.15, np.asarray(robot.upper) - 0.15
    q = rng.uniform(low, high, (count * 12, robot.num_joints))
    points, clear = look(jnp.asarray(q, jnp.float32))
    return np.asarray(points)[np.asarray(clear) > 0.03][:count]


@partial(jax.jit, static_argnames=("steps",))
def outcomes(policy: ArmPolicy, world: World, goals: jax.Array, steps: int) -> Outcome:
    """Outcomes [goals] of rollouts from the ready posture to every goal in one world."""
    robot = policy.robot
    spheres = panda_spheres()
    moving = spheres.moving(robot)
    obstacle = ObstacleDistances(moving.points(robot), world, moving.radii)
    own = SelfDistances(spheres.points(robot), panda_self_pairs(), spheres.radii)
    hand = ControlPoints(robot, HAND)

    def one(goal):
        tree = policy.tree(jnp.eye(4).at[:3, 3].set(goal), world)

        def step(state, _):
            q, qd, seen = state
            seen = Outcome(
                jnp.minimum(seen.obstacle, obstacle(q).min()),
                jnp.minimum(seen.self_collision, own(q).min()),
                jnp.maximum(seen.speed, (jnp.abs(qd) / robot.velocity_limit).max()),
                jnp.minimum(seen.margin, jnp.minimum(q - robot.lower, robot.upper - q).min()),
                jnp.linalg.norm(hand(q)[0] - goal),
                seen.finite & jnp.isfinite(q).all() & jnp.isfinite(qd).all(),
            )
            qd = qd + DT * acceleration(tree, q, qd)
            return (q + DT * qd, qd, seen), None

        q = jnp.asarray(READY, goal.dtype)
        far, none = jnp.full((), jnp.inf, q.dtype), jnp.zeros((), q.dtype)
        start = q, jnp.zeros_like(q), Outcome(far, far, none, far, far, jnp.asarray(True))
        return jax.lax.scan(step, start, length=steps)[0][2]

    return jax.vmap(one)(goals)


def rows() -> list[dict[str, Any]]:
    """One row a scene, then all together: worst figures in mm, rad and shares of the limits, and goals reached."""
    robot = panda()
    goals = random_goals(np.random.default_rng([SEED, SCENES]), robot, GOALS)
    numbers = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (whole_arm(robot), goals))
    found, total = [], []
    for scene in range(SCENES):
        world = random_world(np.random.default_rng([SEED, scene]), robot)
        clear = np.asarray(jax.vmap(world.signed_distance)(numbers[1])).min(axis=1) >= FREE
        begun = time.perf_counter()
        outcome = jax.tree.map(np.asarray, outcomes(numbers[0], world, numbers[1], round(DURATION / DT) + 1))
        total.append((outcome, clear))
        found.append(_row(f"scene {scene}", *total[-1]) | {"seconds": time.perf_counter() - begun})
        print(found[-1], file=sys.stderr, flush=True)
    parts = [jax.tree.map(lambda *x: np.concatenate(x), *column) for column in zip(*total, strict=True)]
    return [*found, _row("all", *parts) | {"seconds": sum(row["seconds"] for row in found)}]


def _row(name: str, outcome: Outcome, clear: np.ndarray) -> dict[str, Any]:
    near = outcome.goal < NEAR
    return {
        "name": name,
        "rollouts": len(clear),
        "not_finite": int((~outcome.finite).sum()),
        "penetrations": int(((outcome.obstacle < -1e-3) | (outcome.self_collision < -1e-3)).sum()),
        "least_obstacle_mm": 1e3 * float(outcome.obstacle.min()),
        "least_self_mm": 1e3 * float(outcome.self_collision.min()),
        "most_speed": float(outcome.speed.max()),
        "least_margin_rad": float(outcome.margin.min()),
        "free_goals": int(clear.sum()),
        "reached": int((near & clear).sum()),
        "reached_share": float((near & clear).sum() / clear.sum()),
    }
