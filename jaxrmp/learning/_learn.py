"""From demonstrations to a skill: the paper's steps, one after the other."""

import time
import warnings
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DemonstrationError, FileWarning
from ..kinematics import Robot, forward_kinematics, frame_poses
from ..leaves import Learned, NominalPotential
from ._closed_paths import check_paths
from ._configuration import Configuration, MetricSettings
from ._demonstrations import Demonstration, DemonstrationSet
from ._families import families
from ._fit_to_robot import fit_to_robot
from ._metric_training import MetricFit, train_metrics
from ._nominal import nominal_demonstration
from ._potential_choice import PotentialChoice, choose_potential
from ._preprocessing import Preprocessed, preprocess
from ._skill import Skill, joint_leaves, mean_pose, rigid_targets
from ._subtask_trajectories import SubtaskTrajectories, subtask_trajectories
from ._support import support_of_samples

Progress = Callable[[str, float], None]


class PreparedDemonstrations(NamedTuple):
    """Demonstrations as control points in the object's frame.

    `joints`, the preprocessed joint trajectories; `poses` [N, 4, 4], the object's frame in the world of the
    robot's model in each;
    `points`, N arrays [T, K, 3], m, in that frame; `subtasks`, those with each end moved to the origin, resampled;
    `frame` says which frame it is.
    """

    joints: Preprocessed
    poses: np.ndarray
    points: tuple[np.ndarray, ...]
    subtasks: SubtaskTrajectories
    frame: str


class Learning(NamedTuple):
    """A learned `skill` and how it was learned: from `prepared` demonstrations, K indices of the `nominal` ones, K
    `potentials`, the `metric` fit, and `seconds` by step."""

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
    that warp the potentials' gradients until they reproduce every demonstration. Before, a `FileWarning` says which
    demonstrations disagree, as `families` finds.

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
    if not (found := families(prepared.points)).agree:
        warnings.warn(f"{demonstrations.source}: {found}", FileWarning, stacklevel=2)
    lap("preprocessing")
    nominal, potentials = [], []
    K = len(configuration.subtasks)
    for k, positions in enumerate(prepared.subtasks.positions):
        progress("potentials", k / K)
        nominal.append(nominal_demonstration(list(positions))[0])
        found = choose_potential(
            *(positions, prepared.subtasks.directions[k], nominal[-1]),
            seed=configuration.seed,
            progress=lambda fraction, k=k: progress("potentials", (k + fraction) / K),
            **asdict(configuration.potential),
        )
        potentials.append(found)
    progress("potentials", 1.0)
    lap("potentials")
    potential = _stacked([choice.fit.potential for choice in potentials])
    metric = _train(configuration, prepared.subtasks, potential, progress)
    lap("metrics")
    seconds |= {"metric_compilation": metric.compilation_seconds, "metric_loop": metric.loop_seconds}
    policy = configuration.policy
    gains = (jnp.full(K, gain, jnp.float32) for gain in (policy.speed, policy.damping_rate))
    frames, offsets = control_point_frames(configuration)
    joint_damping, joint_limit, limited = joint_leaves(robot, policy)
    skill = Skill(
        learned=Learned(potential, metric.factors, *gains),
        joint_damping=joint_damping,
        joint_limit=joint_limit,
        offsets=jnp.asarray(offsets, jnp.float32),
        targets=jnp.asarray(rigid_targets(offsets, frames, prepared.subtasks.ends), jnp.float32),
        T_world_object=jnp.asarray(mean_pose(prepared.poses), jnp.float32),
        R_object_hand=jnp.asarray(demonstrated_end(prepared, robot, frames[0])[:3, :3], jnp.float32),
        frames=frames,
        subtasks=tuple(subtask.name for subtask in configuration.subtasks),
        limited=limited,
        configuration=configuration if demonstrations.object_names else replace(configuration, object=""),
        robot_fingerprint=robot.fingerprint,
        source=demonstrations.source,
    )
    return Learning(skill, prepared, tuple(nominal), tuple(potentials), metric, seconds)


def prepare(configuration: Configuration, robot: Robot, demonstrations: DemonstrationSet) -> PreparedDemonstrations:
    """Preprocess demonstrations and bring the control points into the object's frame.

    The object's frame is its pose at each demonstration's first sample; if the configuration or the whole set has no
    tracked object, it has the axes of the robot's `base` frame and its origin at the mean final position of the first
    control point. The demonstrations are made the robot's own first, as `fit_to_robot` does.

    **Arguments**: `configuration`; its `robot`; `demonstrations`. **Raises** `DemonstrationError` if the object moves
    during a demonstration, or a control point ends where it began or crosses its own path, which no stable policy can
    follow; and what `fit_to_robot`, `preprocess` and `subtask_trajectories` raise.
    """
    recorded = fit_to_robot(demonstrations, robot)
    joints = preprocess(recorded, configuration.preprocessing)
    frames, offsets = control_point_frames(configuration)
    world_points = [control_points(robot, frames, offsets, q) for q in joints.q]
    with jax.enable_x64(True):
        rest = jnp.zeros(robot.num_joints)
        T_world_base = np.asarray(forward_kinematics(robot, rest, configuration.base))
    tracked = bool(configuration.object and demonstrations.object_names)
    if tracked:
        tolerance = configuration.target.object_tolerance
        poses = T_world_base @ np.stack(
            [still_pose(d, configuration.object, tolerance, k) for k, d in enumerate(demonstrations)]
        )
    else:
        poses = np.tile(T_world_base, (len(world_points), 1, 1))
        poses[:, :3, 3] = np.mean([points[-1, 0] for points in world_points], axis=0)
    points = tuple(in_frame(p, T) for p, T in zip(world_points, poses, strict=True))
    subtasks = subtask_trajectories(
        points,
        samples=configuration.preprocessing.samples,
        resample=configuration.preprocessing.resample,
        taper=configuration.target.taper,
        end_tolerance=configuration.target.end_tolerance,
    )

    def sample_of(k: int, n: int, fraction: float) -> int:
        path = control_points(robot, frames[k : k + 1], offsets[k : k + 1], recorded[n].q)[:, 0]
        length = np.concatenate([[0.0], np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum()])
        return int(np.searchsorted(length, fraction * length[-1]))

    names = [subtask.name for subtask in configuration.subtasks]
    check_paths(subtasks.positions, names, configuration.metric.spread, sample_of)
    frame = f"object {configuration.object}" if tracked else f"axes of {configuration.base}, origin at the mean end"
    return PreparedDemonstrations(joints, poses, points, subtasks, frame)


def still_pose(demonstration: Demonstration, name: str, tolerance: float, index: int = 0) -> np.ndarray:
    """The pose [4, 4] of an object at the first sample of a demonstration in which it stands still.

    **Raises** `DemonstrationError` if it gets further than `tolerance`, m, from there; `UnknownNameError`.
    """
    first = demonstration.pose(name)
    positions = demonstration.poses[name].reshape(-1, 4, 4)[:, :3, 3]
    moved = np.linalg.norm(positions - first[:3, 3], axis=-1).max()
    if moved > tolerance:
        raise DemonstrationError(
            f"{name!r} moves by {100 * moved:.1f} cm during demonstration {index}, allowed {100 * tolerance:.1f} cm: "
            "the demonstrated path is not one path in its frame. Leave the demonstration out, choose an object that "
            "stands still, or raise target.object_tolerance."
        )
    return first


def control_point_frames(configuration: Configuration) -> tuple[tuple[str, ...], np.ndarray]:
    """The frames of the control points in `configuration`, and their offsets [K, 3] in them, m."""
    frames = tuple(subtask.frame for subtask in configuration.subtasks)
    return frames, np.array([subtask.offset for subtask in configuration.subtasks])


def in_frame(points: np.ndarray, T: np.ndarray) -> np.ndarray:
    """World `points` [..., 3] seen from the frame at pose `T` [4, 4]."""
    return (points - T[:3, 3]) @ T[:3, :3]


@partial(jax.jit, static_argnums=2)
def _poses(robot: Robot, q: jax.Array, frames: tuple[str, ...]) -> jax.Array:
    return jax.vmap(lambda q: frame_poses(robot, q, frames))(q)


def control_points(robot: Robot, frames: tuple[str, ...], offsets: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Positions [T, K, 3], m, in the world, of points at `offsets` [K, 3] in `frames` of `robot`, along `q` [T, n]."""
    with jax.enable_x64(True):
        poses = np.asarray(_poses(robot, jnp.asarray(np.asarray(q, float)), tuple(frames)))
    return np.einsum("tkij,kj->tki", poses[:, :, :3, :3], offsets) + poses[:, :, :3, 3]


def demonstrated_end(prepared: PreparedDemonstrations, robot: Robot, frame: str) -> np.ndarray:
    """Where `prepared` demonstrations leave `frame` of `robot`, in the object's frame: the mean pose [4, 4].

    **Raises** `UnknownNameError` for a frame that is not there.
    """
    with jax.enable_x64(True):
        ends = [np.asarray(forward_kinematics(robot, q[-1], frame)) for q in prepared.joints.q]
    return mean_pose(np.stack([np.linalg.inv(T) @ end for T, end in zip(prepared.poses, ends, strict=True)]))


def training_samples(
    subtasks: SubtaskTrajectories, settings: MetricSettings, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """What the metrics are trained on: positions and target velocities, both [K, S, 3].

    Every second sample of every demonstration, and a copy of it displaced by normal noise of standard deviation
    `settings.spread` across the direction of motion, whose target velocity is turned back to the demonstration so far
    that it would arrive `settings.convergence` further on. The copies make the field converge in a tube around each
    demonstration: without them a rollout that drifts a little may be sent astray.

    **Arguments**: `subtasks`, of all demonstrations; `settings`, of the metric; `seed`, of the noise.
    """
    K = len(subtasks.positions)
    x, v = subtasks.positions[:, :, 1::2], subtasks.velocities[:, :, 1::2]
    along = subtasks.directions[:, :, 1::2]
    noise = np.random.default_rng(seed).normal(size=x.shape) * settings.spread
    noise -= (noise * along).sum(-1, keepdims=True) * along
    noise[np.linalg.norm(x, axis=-1) < settings.spread] = 0  # near the goal the target velocity is not parallel
    back = along - noise / settings.convergence
    back *= np.linalg.norm(v, axis=-1, keepdims=True) / np.linalg.norm(back, axis=-1, keepdims=True)
    pairs = [(x, v), (x + noise, back)]
    return tuple(np.concatenate([pair[i] for pair in pairs], axis=2).reshape(K, -1, 3) for i in range(2))  # type: ignore[return-value]


def _train(
    configuration: Configuration, subtasks: SubtaskTrajectories, potential: NominalPotential, progress: Progress
) -> MetricFit:
    samples = training_samples(subtasks, configuration.metric, configuration.seed)
    x, velocity = (jnp.asarray(a, jnp.float32) for a in samples)
    slope = jax.jit(jax.vmap(lambda potential, x: jax.vmap(jax.grad(potential))(x)))(potential, x)
    settings = asdict(configuration.metric)
    reach, *_ = (settings.pop(name) for name in ("reach", "spread", "convergence"))
    demonstrated = subtasks.positions[:, :, 1::4].reshape(len(x), -1, x.shape[-1])
    support = _stacked([support_of_samples(samples, reach) for samples in demonstrated]) if reach > 0 else None
    told = {"progress": lambda done, loss: progress("metrics", done / settings["updates"])}
    return train_metrics(x, slope, velocity, seed=configuration.seed, support=support, **told, **settings)


def _stacked(potentials: list[Any]) -> Any:
    """Several potentials as one with a leading axis, float32."""
    return jax.tree.map(lambda *a: jnp.stack([jnp.asarray(v, jnp.float32) for v in a]), *potentials)
