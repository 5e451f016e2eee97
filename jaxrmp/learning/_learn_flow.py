"""From demonstrations to a flow of the whole hand."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..kinematics import Robot
from ._arc_length import resample_by_arc_length
from ._configuration import Configuration
from ._flow_training import FlowFit, rays, train_flow
from ._hand_flow import HandFlow, hand_flow, hand_points, postures_of, stacked_points
from ._prepare import PreparedDemonstrations, control_point_frames, control_points, in_frame
from ._skill import mean_pose, rigid_targets

_FAR = 1500  # postures drawn from the joint range, where the flow is to leave space as it is
_TUBE = 25  # postures of the funnel along each way


class FlowLearning(NamedTuple):
    """A `motion` for a skill and how its flow was trained, `fit`; `paths`, N arrays [T, m], what it was trained on: the
    hand's points less their ends, stacked, m."""

    motion: HandFlow
    fit: FlowFit
    paths: tuple[np.ndarray, ...]


def learn_flow(
    configuration: Configuration,
    robot: Robot,
    prepared: PreparedDemonstrations,
    progress: Callable[[str, float], None],
) -> FlowLearning:
    """One flow of the whole hand from `prepared` demonstrations, and a funnel along the ways that it leads.

    **Arguments**: `configuration`, whose section `flow` counts; its `robot`; `prepared`, by `prepare`; `progress`,
    called with the name of the step and the fraction of it that is done. **Returns** a `FlowLearning`.
    **Raises** `TrainingError` as `train_flow`.
    """
    settings = configuration.flow
    frames, own = control_point_frames(configuration)
    points = offsets, turned = hand_points(frames, own, settings.circumradius)
    frames = frames[:1] * len(offsets) if turned else frames
    T = mean_pose(prepared.poses)
    places = [
        in_frame(control_points(robot, frames, offsets, q), pose)
        for q, pose in zip(prepared.joints.q, prepared.poses, strict=True)
    ]
    paths = tuple(_stacked(place - place[-1]) for place in places)
    targets = rigid_targets(offsets, frames, np.stack([place[-1] for place in places]))
    far = _stacked(in_frame(control_points(robot, frames, offsets, _anywhere(robot)), T) - targets)
    fit = train_flow(
        paths,
        far,
        settings,
        configuration.seed,
        lambda done, loss: progress("flow", done / settings.updates),
    )
    left = np.linspace(1.0, 0.0, _TUBE, dtype=np.float32)
    ways = np.asarray(rays(fit.flow, np.stack([path[0] for path in paths]).astype(np.float32), left))
    seeds = [resample_by_arc_length(q, _TUBE) for q in prepared.joints.q]
    tube = np.concatenate(postures_of(robot, stacked_points(robot, frames, offsets, T, targets), ways, seeds))
    end = np.mean([q[-1] for q in prepared.joints.q], axis=0)
    motion = hand_flow(robot, frames, fit.flow, points, targets, tube, end, settings, configuration.policy)
    return FlowLearning(motion, fit, paths)


def _stacked(points: np.ndarray) -> np.ndarray:
    return points.reshape(len(points), -1) / np.sqrt(points.shape[1])


def _anywhere(robot: Robot) -> np.ndarray:
    """Postures all over the joint range [S, n]; one turn of joints without limits."""
    lower, upper = np.asarray(robot.lower, float), np.asarray(robot.upper, float)
    bounded = np.isfinite(lower) & np.isfinite(upper)
    lower, upper = np.where(bounded, lower, -np.pi), np.where(bounded, upper, np.pi)
    return np.random.default_rng(0).uniform(lower, upper, (_FAR, len(lower)))
