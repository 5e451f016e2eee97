"""From demonstrations to a skill: the paper's steps, one after the other."""

import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DemonstrationError
from ..kinematics import Robot, frame_poses
from ..leaves import Learned
from ._configuration import Configuration, MetricSettings
from ._demonstrations import DemonstrationSet
from ._metric_training import MetricFit, train_metrics
from ._nominal import nominal_demonstration
from ._potential_choice import PotentialChoice, choose_potential
from ._preprocessing import Preprocessed, preprocess
from ._skill import Skill, mean_pose, rigid_targets
from ._subtask_trajectories import SubtaskTrajectories, subtask_trajectories

Progress = Callable[[str, float], None]


class PreparedDemonstrations(NamedTuple):
    """Demonstrations as control points in the object's frame.

    `joints`, the preprocessed joint trajectories; `poses` [N, 4, 4], the object's frame in the base frame in each;
    `points`, N arrays [T, K, 3], m, in that frame; `subtasks`, those with each end moved to the origin, resampled.
    """

    joints: Preprocessed
    poses: np.ndarray
    points: tuple[np.ndarray, ...]
    subtasks: SubtaskTrajectories


class Learning(NamedTuple):
    """A learned skill and all that the report tells of how it was learned."""

    skill: Skill
    prepared: PreparedDemonstrations
    nominal: tuple[int, ...]
    potentials: tuple[PotentialChoice, ...]
    metric: MetricFit
    seconds: dict[str, float]


def learn(
    configuration: Configuration, robot: Robot, demonstrations: DemonstrationSet, progress: Progress | None = None
) -> Learning:
    """Learn a skill of several subtasks from a demonstration set.

    For each control point: the nominal demonstration, the one nearest to all others in DTW; a potential around it
    from a convex program, its kernel width chosen with the basin checked; then for all of them at once the metrics
    that warp the potentials' gradients until they reproduce every demonstration.

    **Arguments**: `configuration`; `robot`, with the demonstrations' joints in the same order; `demonstrations`;
    `progress`, called with the name of a step and the fraction of it that is done.
    **Returns** a `Learning`.
    **Raises** what its steps raise, above all `DemonstrationError`, `ConvexProgramError`, `BasinError`,
    `TrainingError`, and `UnknownNameError` for a frame or object that is not there.

    Rana et al. 2019, section 3.
    """
    progress = progress or (lambda step, fraction: None)
    seconds: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(name: str) -> None:
        nonlocal clock
        seconds[name], clock = time.perf_counter() - clock, time.perf_counter()

    progress("preprocessing", 0.0)
    prepared = prepare(configuration, robot, demonstrations)
    lap("preprocessing")
    nominal, potentials = [], []
    K = len(configuration.subtasks)
    for k, positions in enumerate(prepared.subtasks.positions):
        progress("potentials", k / K)
        nominal.append(nominal_demonstration(list(positions))[0])
        settings = asdict(configuration.potential)
        directions = prepared.subtasks.directions[k]
        potentials.append(choose_potential(positions, directions, nominal[-1], seed=configuration.seed, **settings))
    progress("potentials", 1.0)
    lap("potentials")
    metric = _train(configuration, prepared.subtasks, potentials, progress)
    lap("metrics")
    seconds |= {"metric_compilation": metric.compilation_seconds, "metric_loop": metric.loop_seconds}
    policy = configuration.policy
    learned = Learned(
        _stacked([choice.fit.potential for choice in potentials]),
        metric.factors,
        jnp.full(K, policy.speed, jnp.float32),
        jnp.full(K, policy.damping_rate, jnp.float32),
    )
    frames = tuple(subtask.frame for subtask in configuration.subtasks)
    offsets = np.array([subtask.offset for subtask in configuration.subtasks])
    skill = Skill(
        learned=learned,
        offsets=jnp.asarray(offsets, jnp.float32),
        targets=jnp.asarray(rigid_targets(offsets, frames, prepared.subtasks.ends), jnp.float32),
        T_base_object=jnp.asarray(mean_pose(prepared.poses), jnp.float32),
        frames=frames,
        subtasks=tuple(subtask.name for subtask in configuration.subtasks),
        configuration=configuration,
        robot_fingerprint=robot.fingerprint,
        source=demonstrations.source,
    )
    return Learning(skill, prepared, tuple(nominal), tuple(potentials), metric, seconds)


def prepare(configuration: Configuration, robot: Robot, demonstrations: DemonstrationSet) -> PreparedDemonstrations:
    """Preprocess demonstrations and bring the control points into the object's frame.

    The object's frame is its pose at each demonstration's first sample; if the configuration or the whole set has no
    tracked object, it is the base axes with their origin at the mean final position of the first control point.

    **Raises** `DemonstrationError` if the joints are not the robot's, and what `preprocess` and
    `subtask_trajectories` raise.
    """
    if len(demonstrations.joint_names) != robot.num_joints or (
        set(demonstrations.joint_names) <= set(robot.joint_names)
        and tuple(demonstrations.joint_names) != tuple(robot.joint_names)
    ):
        raise DemonstrationError(
            f"demonstrations have joints {list(demonstrations.joint_names)}, robot {robot.name!r} has "
            f"{list(robot.joint_names)}. Fix the robot's other joints (fixed_joints), or load the right robot."
        )
    joints = preprocess(demonstrations, configuration.preprocessing)
    frames = tuple(subtask.frame for subtask in configuration.subtasks)
    offsets = np.array([subtask.offset for subtask in configuration.subtasks])
    base_points = [control_points(robot, frames, offsets, q) for q in joints.q]
    if configuration.object and demonstrations.object_names:
        poses = np.stack([demonstration.pose(configuration.object) for demonstration in demonstrations])
    else:
        poses = np.tile(np.eye(4), (len(base_points), 1, 1))
        poses[:, :3, 3] = np.mean([points[-1, 0] for points in base_points], axis=0)
    points = tuple((p - T[:3, 3]) @ T[:3, :3] for p, T in zip(base_points, poses, strict=True))
    subtasks = subtask_trajectories(
        points,
        samples=configuration.preprocessing.samples,
        resample=configuration.preprocessing.resample,
        taper=configuration.target.taper,
        end_tolerance=configuration.target.end_tolerance,
    )
    return PreparedDemonstrations(joints, poses, points, subtasks)


def control_points(robot: Robot, frames: tuple[str, ...], offsets: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Positions [T, K, 3], m, in the base frame, of points at `offsets` [K, 3] in `frames`, along `q` [T, n]."""
    with jax.enable_x64(True):
        poses = np.asarray(jax.vmap(lambda q: frame_poses(robot, q, frames))(jnp.asarray(np.asarray(q, float))))
    return np.einsum("tkij,kj->tki", poses[:, :, :3, :3], offsets) + poses[:, :, :3, 3]


def training_samples(
    subtasks: SubtaskTrajectories, settings: MetricSettings, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """What the metrics are trained on: positions and target velocities, both [K, S, 3].

    Every second sample of every demonstration, and a copy of it displaced by normal noise of standard deviation
    `settings.spread` across the direction of motion that keeps its target velocity. The copies make the field
    parallel in a tube around each demonstration: without them a rollout that drifts a little may be sent astray.
    """
    K = len(subtasks.positions)
    x, v = subtasks.positions[:, :, 1::2], subtasks.velocities[:, :, 1::2]
    along = subtasks.directions[:, :, 1::2]
    noise = np.random.default_rng(seed).normal(size=x.shape) * settings.spread
    noise -= (noise * along).sum(-1, keepdims=True) * along
    noise[np.linalg.norm(x, axis=-1) < settings.spread] = 0  # near the goal the target velocity is not parallel
    pairs = [(x, v), (x + noise, v)]
    return tuple(np.concatenate([pair[i] for pair in pairs], axis=2).reshape(K, -1, 3) for i in range(2))  # type: ignore[return-value]


def _train(
    configuration: Configuration,
    subtasks: SubtaskTrajectories,
    potentials: list[PotentialChoice],
    progress: Progress,
) -> MetricFit:
    x, velocity = (
        jnp.asarray(a, jnp.float32) for a in training_samples(subtasks, configuration.metric, configuration.seed)
    )
    potential = _stacked([choice.fit.potential for choice in potentials])
    slope = jax.jit(jax.vmap(lambda potential, x: jax.vmap(jax.grad(potential))(x)))(potential, x)
    settings = asdict(configuration.metric)
    del settings["spread"]
    updates = configuration.metric.updates
    return train_metrics(
        x,
        slope,
        velocity,
        seed=configuration.seed,
        progress=lambda done, loss: progress("metrics", done / updates),
        **settings,
    )


def _stacked(potentials: list[Any]) -> Any:
    """Several potentials as one with a leading axis, float32."""
    return jax.tree.map(lambda *a: jnp.stack([jnp.asarray(v, jnp.float32) for v in a]), *potentials)
