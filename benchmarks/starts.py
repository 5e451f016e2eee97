"""From where a skill arrives: starts all over the joint range, near the demonstrated ones, and with the object moved.

Kinematic, the whole arm's policy, steps of 5 ms. Tasks are the recordings in $JAXRMP_DATA, see `recorded`.
"""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial

from jaxrmp import Node, pushforward
from jaxrmp._linalg import cholesky_solve, matmul
from jaxrmp._palette import BLUE, ORANGE, VERMILLION
from jaxrmp._rotations import rotation_of_vector
from jaxrmp.evaluation import Evaluation, evaluate, limit_leaf, sample_starts, skill_problem, starts_around
from jaxrmp.kinematics import Robot
from jaxrmp.learning import Skill, learn
from jaxrmp.learning._reproduce import rollouts_of
from jaxrmp.policies import ArmPolicy, whole_arm_policy
from jaxrmp.simulation import End, KinematicEngine, StopCriteria
from jaxrmp.visualization._style import MARKER, Figure, label_axes, legend_below, new_figure
from jaxrmp.world import World

from ._report import FOLDER
from ._skills import recorded

TASKS = ("drawer_closing", "door_reaching", "cup_round")
SEEDS = range(5)
_ALL_OVER, _OF_OTHER_SEEDS, _NEAR, _MOVED = 4096, 512, 200, 512  # starts
_SPREAD = 0.15  # rad, of near ones
_FARTHEST, _MOST_TURNED = 0.1, 20.0  # m and degrees, of an object that is moved
_DT, _SECONDS, _BATCH = 0.005, 60.0, 64
_WORST, _FINE_DT = 64, 0.001  # starts whose energy rises most are looked at again in finer steps
_ARRIVED = 0.01  # m, every control point


def rows() -> list[dict[str, Any]]:
    """One row a task and seed; 4,096 starts with the first seed, 512 with the others."""
    tasks = TASKS if os.environ.get("JAXRMP_DATA") else TASKS[:2]  # nobody scripted the third
    return [_row(task, seed) for task in tasks for seed in SEEDS]


def _row(task: str, seed: int) -> dict[str, Any]:
    configuration, demonstrations = recorded(task)
    robot = configuration.load_robot()
    learning = learn(replace(configuration, seed=seed, method="flow"), robot, demonstrations)
    skill, begin = learning.skill, np.stack([q[0] for q in learning.prepared.joints.q])
    problem = skill_problem(skill, robot)
    count = _OF_OTHER_SEEDS if seed else _ALL_OVER

    def ends(starts: np.ndarray, dt: float = _DT) -> Evaluation:
        engine = KinematicEngine(problem, StopCriteria(duration=_SECONDS), dt=dt, chunk=round(0.5 / dt))
        return evaluate(engine, problem, limit_leaf(skill, robot), starts)

    everywhere = ends(sample_starts(problem, count))
    worst = np.argsort(everywhere.energy_increase)[-_WORST:]
    finer = ends(everywhere.starts[worst], _FINE_DT)
    if seed == SEEDS[0]:
        np.savez(_ends_of(task), hand=everywhere.start_hand, kind=everywhere.ends.kind)
    near = ends(starts_around(problem, begin, _NEAR, spread=_SPREAD))
    arrived, within_reach = _moved(skill, robot, sample_starts(problem, _MOVED))
    kind, rise = everywhere.ends.kind, everywhere.energy_increase
    return {
        "name": task,
        "seed": seed,
        "starts": count,
        "arrive_percent": _percent(kind == End.CONVERGED),
        "at_limit_percent": _percent(kind == End.STOPPED_AT_LIMIT),
        "non_finite": int((kind == End.DIVERGED).sum()),
        "energy_increase": float(rise.max()),
        "energy_increase_in_1_ms_steps": float(finer.energy_increase.max()),
        "near_arrive_percent": _percent(near.ends.kind == End.CONVERGED),
        "moved_arrive_percent": _percent(arrived),
        "moved_within_reach_percent": _percent(within_reach),
        "moved_within_reach_arrive_percent": _percent(arrived[within_reach]),
    }


def figure(rows: list[dict[str, Any]]) -> Figure:
    """Where the hand began, from the side, and how that ended: the first seed's starts of each task."""
    drawn = new_figure()
    tasks = list(dict.fromkeys(row["name"] for row in rows))
    panels = drawn.subplots(1, len(tasks), squeeze=False, sharey=True)[0]
    for axes, task in zip(panels, tasks, strict=True):
        with np.load(_ends_of(task)) as ends:
            hand, kind = ends["hand"], ends["kind"]
        for end, name, colour, size in (
            (kind == End.CONVERGED, "arrives", BLUE, MARKER / 2),
            (kind == End.STOPPED_AT_LIMIT, "at a joint limit", ORANGE, 4 * MARKER),
            (~np.isin(kind, (End.CONVERGED, End.STOPPED_AT_LIMIT)), "neither", VERMILLION, 4 * MARKER),
        ):
            if end.any():
                axes.scatter(*hand[end][:, ::2].T, size, colour, label=name)
        axes.set_aspect("equal")
        arrive = f"{(kind == End.CONVERGED).sum():,} of {len(kind):,} arrive"
        label_axes(axes, "x (m)", "z (m)" if axes is panels[0] else "", f"{task.replace('_', ' ')}\n{arrive}")
    legend_below(drawn, *panels)
    return drawn


def _ends_of(task: str) -> Path:
    FOLDER.mkdir(parents=True, exist_ok=True)
    return FOLDER / f"starts_{task}.npz"


def _percent(of: np.ndarray) -> float:
    return 100 * float(np.mean(of))


def _moved(skill: Skill, robot: Robot, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether it arrives from each of `starts` [N, n] with the object moved otherwise each time, and whether inverse
    kinematics does from where the skill ends, the hand turned as demonstrated: it may be out of the arm's reach."""
    poses = moved_poses(np.asarray(skill.T_world_object, float), len(starts))
    policy, error = Partial(_tree, whole_arm_policy(skill, robot)), []
    for first in range(0, len(starts), _BATCH):
        rows = slice(first, first + _BATCH)
        q = rollouts_of(policy, (poses[rows],), starts[rows], _SECONDS, _DT).q[:, -1]
        error.append(_errors(skill, robot, q, poses[rows]))
    assert skill.flow is not None and skill.flow.posture is not None  # the default method, unless refused
    end = np.repeat(np.asarray(skill.flow.posture.postures), len(poses), axis=0)
    solved, left = (
        np.asarray(a) for a in _inverse(skill, robot, jnp.asarray(end, jnp.float32), jnp.asarray(poses, jnp.float32))
    )
    reached = (np.linalg.norm(left, axis=1) < _ARRIVED) & (_errors(skill, robot, solved, poses) < _ARRIVED)
    return np.concatenate(error) < _ARRIVED, reached


def _tree(policy: ArmPolicy, T: jax.Array) -> Node:
    return policy.tree(T, World())


def moved_poses(T: np.ndarray, count: int, seed: int = 1) -> np.ndarray:
    """Poses [N, 4, 4] of an object at `T`, moved within a ball and turned about any axis."""
    rng, poses = np.random.default_rng(seed), np.repeat(T[None], count, axis=0)
    direction, axis = (a / np.linalg.norm(a, axis=1, keepdims=True) for a in rng.normal(size=(2, count, 3)))
    poses[:, :3, 3] += _FARTHEST * rng.uniform(size=(count, 1)) ** (1 / 3) * direction
    angle = np.radians(_MOST_TURNED) * rng.uniform(-1, 1, (count, 1))
    poses[:, :3, :3] = rotation_of_vector(angle * axis) @ poses[:, :3, :3]
    return poses


def _errors(skill: Skill, robot: Robot, q: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """How far the farthest control point is from its target [N], m."""
    points = jax.jit(jax.vmap(lambda q, T: skill.task_map(robot, T)(q)))(
        jnp.asarray(q), jnp.asarray(poses, jnp.float32)
    )
    return np.linalg.norm(points, axis=-1).max(-1)


def _inverse(
    skill: Skill, robot: Robot, q: jax.Array, poses: jax.Array, steps: int = 100
) -> tuple[jax.Array, jax.Array]:
    """Postures [N, n] by damped least squares from `q` [N, n], within the limits, and how far the hand is off [N, m],
    in the flow's space."""
    motion = skill.flow
    assert motion is not None
    lower, upper = jnp.asarray(robot.lower, jnp.float32), jnp.asarray(robot.upper, jnp.float32)

    def solve(q, T):
        hand = motion.task_map(robot, skill.frames, T, None)

        def step(q, _):
            y, _, J, _ = pushforward(hand, q, jnp.zeros_like(q))
            move = matmul(J.T, cholesky_solve(matmul(J, J.T) + 1e-5 * jnp.eye(len(y)), y))
            return jnp.clip(q - move * jnp.minimum(1, 0.2 / (jnp.linalg.norm(move) + 1e-9)), lower, upper), None

        q, _ = jax.lax.scan(step, q, None, length=steps)
        return q, hand(q)

    return jax.jit(jax.vmap(solve))(q, poses)
