"""Demonstrations as what learning starts from: control points in the object's frame."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import numpy as np

from .._errors import DemonstrationError
from .._pytree import pytree, static
from ..kinematics import Robot, frame_poses
from ..xla import quickly
from ._by_parts import by_parts
from ._closed_paths import check_paths
from ._configuration import Configuration
from ._demonstrations import Demonstration, DemonstrationSet
from ._fit_to_robot import fit_to_robot
from ._hand_flow import triangle_round
from ._preprocessing import Preprocessed, preprocess
from ._skill import mean_pose
from ._subtask_trajectories import SubtaskTrajectories, subtask_trajectories

_AT_ONCE = 256  # postures in a call of what is compiled


@pytree
class _Frames:
    """`names` of frames of a `robot`."""

    robot: Robot
    names: tuple[str, ...] = static()


class PreparedDemonstrations(NamedTuple):
    """Demonstrations as control points in the object's frame; of an orientation about their middle, `about_middle`.

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


def prepare(configuration: Configuration, robot: Robot, demonstrations: DemonstrationSet) -> PreparedDemonstrations:
    """Preprocess demonstrations and bring the control points into the object's frame.

    The object's frame is its pose at each demonstration's first sample; if the configuration or the whole set has no
    tracked object, it has the axes of the robot's `base` frame and its origin at the mean final position of the first
    control point, or of the middle of a hand. The demonstrations are made the robot's own first, as `fit_to_robot`
    does.

    **Arguments**: `configuration`; its `robot`; `demonstrations`. **Raises** `DemonstrationError` if the object moves
    during a demonstration, or a control point ends where it began or crosses its own path, which no stable policy can
    follow; and what `fit_to_robot`, `preprocess` and `subtask_trajectories` raise.
    """
    recorded = fit_to_robot(demonstrations, robot)
    joints = preprocess(recorded, configuration.preprocessing)
    frames, offsets = control_point_frames(configuration)
    world_points = [control_points(robot, frames, offsets, q) for q in joints.q]
    T_world_base = poses_along(robot, (configuration.base,), np.zeros((1, robot.num_joints)))[0, 0]
    tracked = bool(configuration.object and demonstrations.object_names)
    if tracked:
        tolerance = configuration.target.object_tolerance
        poses = T_world_base @ np.stack(
            [still_pose(d, configuration.object, tolerance, k) for k, d in enumerate(demonstrations)]
        )
    else:
        poses = np.tile(T_world_base, (len(world_points), 1, 1))
        ends = np.stack([points[-1] for points in world_points])
        poses[:, :3, 3] = ends.mean((0, 1)) if configuration.of_hand else ends[:, 0].mean(0)
    points = tuple(in_frame(p, T) for p, T in zip(world_points, poses, strict=True))
    if configuration.of_turn:
        points = tuple(about_middle(p) for p in points)
    subtasks = subtask_trajectories(
        points,
        samples=configuration.preprocessing.samples,
        resample=configuration.preprocessing.resample,
        taper=configuration.target.taper,
        end_tolerance=configuration.target.end_tolerance,
    )

    def sample_of(k: int, n: int, fraction: float) -> int:
        path = control_points(robot, frames, offsets, recorded[n].q)
        path = (about_middle(path) if configuration.of_turn else path)[:, k]
        length = np.concatenate([[0.0], np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum()])
        return int(np.searchsorted(length, fraction * length[-1]))

    names = list(control_point_names(configuration))
    paths = subtasks.positions
    if configuration.method != "paper":  # all control points in one space: what counts is where they are together
        K, names = len(names), [", ".join(names)]
        paths = np.concatenate(paths, axis=-1)[None] / np.sqrt(K)
    check_paths(paths, names, configuration.metric.spread, sample_of)
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
    """The frames of the control points in `configuration`, and their offsets [K, 3] in them, m.

    A hand is the corners of the triangle that stands for it, `flow.circumradius` round its offset.
    """
    radius = configuration.flow.circumradius
    points = [
        (subtask.frame, offset)
        for subtask in configuration.subtasks
        for offset in ([subtask.offset] if subtask.kind == "points" else triangle_round(subtask.offset, radius))
    ]
    return tuple(frame for frame, _ in points), np.array([offset for _, offset in points])


def control_point_names(configuration: Configuration) -> tuple[str, ...]:
    """What the K control points in `configuration` are called; the corners of a hand, NAME_0 to NAME_2."""
    return tuple(
        name
        for subtask in configuration.subtasks
        for name in ([subtask.name] if subtask.kind == "points" else [f"{subtask.name}_{k}" for k in range(3)])
    )


def in_frame(points: np.ndarray, T: np.ndarray) -> np.ndarray:
    """World `points` [..., 3] seen from the frame at pose `T` [4, 4]."""
    return (points - T[:3, 3]) @ T[:3, :3]


@quickly
def _poses(frames: _Frames, q: jax.Array) -> jax.Array:
    return jax.vmap(lambda q: frame_poses(frames.robot, q, frames.names))(q)


def poses_along(robot: Robot, frames: Sequence[str], q: np.ndarray) -> np.ndarray:
    """Poses [T, K, 4, 4] of `frames` of `robot` in the world, along `q` [T, n]; **raises** `UnknownNameError`."""
    distinct = tuple(dict.fromkeys(frames))
    poses = by_parts(partial(_poses, _Frames(robot, distinct)), q, _AT_ONCE)
    return poses[:, [distinct.index(name) for name in frames]]


def about_middle(points: np.ndarray) -> np.ndarray:
    """Control points [..., K, 3] less their mean: how they are turned, wherever they are."""
    return points - points.mean(-2, keepdims=True)


def control_points(robot: Robot, frames: tuple[str, ...], offsets: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Positions [T, K, 3], m, in the world, of points at `offsets` [K, 3] in `frames` of `robot`, along `q` [T, n]."""
    poses = poses_along(robot, frames, q)
    return np.einsum("tkij,kj->tki", poses[:, :, :3, :3], offsets) + poses[:, :, :3, 3]


def demonstrated_end(prepared: PreparedDemonstrations, robot: Robot, frame: str) -> np.ndarray:
    """Where `prepared` demonstrations leave `frame` of `robot`, in the object's frame: the mean pose [4, 4].

    **Raises** `UnknownNameError` for a frame that is not there.
    """
    ends = poses_along(robot, (frame,), np.stack([q[-1] for q in prepared.joints.q]))[:, 0]
    return mean_pose(np.stack([np.linalg.inv(T) @ end for T, end in zip(prepared.poses, ends, strict=True)]))
