"""From demonstrations to a flow of the whole hand."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import numpy as np

from .._errors import TrainingError
from .._rotations import rotation_angle
from ..kinematics import Robot
from ..xla import quickly
from ._arc_length import resample_by_arc_length
from ._by_parts import by_parts
from ._configuration import Configuration
from ._flow import initial_flow
from ._flow_training import FlowFit, Timing, train_flow
from ._hand_flow import HandFlow, along_ways, hand_flow, hand_points, with_flow
from ._hand_maps import HandPose, HandTurn, axes_of
from ._prepare import PreparedDemonstrations, control_point_frames, control_points, in_frame
from ._skill import mean_pose, rigid_targets
from ._tempo import demonstrated_tempo, radii

_FAR = 1500  # postures drawn from the joint range, where the flow is to leave space as it is
_MOST_TURNED = 130  # degrees from the end, of a hand
_IN_TIME = 1001  # points of a demonstration, even in time, that has a tempo
_AT_ONCE = 256  # hands in a call of what is compiled
_TUBE = 25  # postures of the funnel along each way


class FlowLesson(NamedTuple):
    """What a flow is trained on: `paths`, N arrays [T, m], and places `far` [F, m] from them, both in its space, m;
    their `timing`, None for a constant tempo; and the `motion` for a skill, its funnel along the demonstrations, all of
    it as it will be but the flow, which is not trained."""

    paths: tuple[np.ndarray, ...]
    far: np.ndarray
    timing: Timing | None
    motion: HandFlow


class FlowLearning(NamedTuple):
    """A `motion` for a skill, its funnel along the demonstrations, and how its flow was trained, `fit`; `paths`, N
    arrays [T, m], what it was trained on, in the flow's space, m."""

    motion: HandFlow
    fit: FlowFit
    paths: tuple[np.ndarray, ...]


def learn_flow(
    configuration: Configuration, lesson: FlowLesson, progress: Callable[[str, float], None]
) -> FlowLearning:
    """One flow of the whole hand.

    **Arguments**: `configuration`, whose section `flow` counts; its `lesson`, by `flow_lesson`; `progress`, called with
    the name of the step and the fraction of it that is done. **Returns** a `FlowLearning`.
    **Raises** `TrainingError` as `train_flow`.
    """
    settings = configuration.flow
    if configuration.of_turn:  # three coordinates are too few for ways that nobody showed: box 2.8 degrees, 4.3 with
        settings = replace(settings, displaced=0)
    if lesson.timing is not None:
        settings = replace(settings, updates=3 * settings.updates // 2)
    fit = train_flow(
        lesson.paths,
        lesson.far,
        settings,
        configuration.seed,
        lambda done, loss: progress("flow", done / settings.updates),
        lesson.timing,
    )
    return FlowLearning(with_flow(lesson.motion, fit.flow, settings.circumradius), fit, lesson.paths)


def flow_lesson(configuration: Configuration, robot: Robot, prepared: PreparedDemonstrations) -> FlowLesson:
    """What a flow is to learn from `prepared` demonstrations, by `prepare`, with the same `configuration` and `robot`.

    **Raises** `TrainingError` for a hand that turns too far.
    """
    settings = configuration.flow
    frames, own = control_point_frames(configuration)
    points = offsets, turned = hand_points(frames, own, settings.circumradius)
    frames = frames[:1] * len(offsets) if turned else frames
    T = mean_pose(prepared.poses)
    as_fast = configuration.policy.tempo == "demonstrated"
    times, ways = prepared.joints.in_time(_IN_TIME) if as_fast else (None, prepared.joints.q)
    places = [
        in_frame(control_points(robot, frames, offsets, q), pose) for q, pose in zip(ways, prepared.poses, strict=True)
    ]
    if turned:
        check_turns(places, settings.circumradius)
    chart = (HandTurn if configuration.of_turn else HandPose) if turned else None
    paths = tuple(_hand(place, place[-1], chart) for place in places)
    targets = rigid_targets(offsets, frames, np.stack([place[-1] for place in places]))
    far = _hand(in_frame(control_points(robot, frames, offsets, _anywhere(robot)), T), targets, chart)
    policy, timing = configuration.policy, None
    taper = {}
    if times is not None:
        tempo = demonstrated_tempo(paths, times, policy.damping_rate)
        policy, taper = replace(policy, speed=tempo.speed), {"taper": tempo.taper}
        timing = Timing([radii(time, tempo, policy.damping_rate) for time in times], tempo.taper)
    flow = initial_flow(configuration.seed, paths[0].shape[-1], settings.couplings, settings.hidden)
    end = np.mean([q[-1] for q in prepared.joints.q], axis=0)
    motion = hand_flow(flow, points, targets, end, settings, policy, **taper)
    motion = led_along(motion, configuration, robot, prepared.joints.q, prepared.poses)
    return FlowLesson(paths, far, timing, motion)


def led_along(
    motion: HandFlow, configuration: Configuration, robot: Robot, ways: Sequence[np.ndarray], poses: np.ndarray
) -> HandFlow:
    """`motion` with its funnel along `ways` [T, n] each, where the object was at `poses` [N, 4, 4]."""
    frames, _ = control_point_frames(configuration)
    resampled = [resample_by_arc_length(way, _TUBE) for way in ways]
    return along_ways(motion, robot, frames, resampled, poses, mean_pose(poses), configuration.flow.lead)


def check_turns(places: Sequence[np.ndarray], radius: float) -> None:
    """**Raises** `TrainingError` for hands, triangles [T, 3, 3] m, that turn farther than `HandTurn` counts in full."""
    for i, place in enumerate(places):
        R = by_parts(partial(_axes, radius), place, _AT_ONCE)
        if not (degrees := np.degrees(rotation_angle(R @ R[-1].T)).max()) <= _MOST_TURNED:
            raise TrainingError(
                f"demonstration {i}: the hand turns by {degrees:.0f} degrees from how it ends, and a flow knows up to "
                f"{_MOST_TURNED}. Cut the beginning off, learn it as two skills, or by points with method 'paper'."
            )


def _hand(points: np.ndarray, targets: np.ndarray, chart: type[HandPose] | type[HandTurn] | None) -> np.ndarray:
    """Points of the hand [T, P, 3] in the space of the flow [T, m], `targets` [P, 3] at zero; by `chart`, if any."""
    stacked = (points - targets).reshape(len(points), -1) / np.sqrt(len(targets))
    if chart is None:
        return stacked
    return by_parts(partial(_posed, chart(targets)), stacked, _AT_ONCE)


@quickly
def _posed(chart: HandPose | HandTurn, stacked: jax.Array) -> jax.Array:
    return jax.vmap(chart)(stacked)


@quickly
def _axes(radius: float, triangles: jax.Array) -> jax.Array:
    return jax.vmap(lambda points: axes_of(points, radius))(triangles)


def _anywhere(robot: Robot) -> np.ndarray:
    """Postures all over the joint range [S, n]; one turn of joints without limits."""
    lower, upper = np.asarray(robot.lower, float), np.asarray(robot.upper, float)
    bounded = np.isfinite(lower) & np.isfinite(upper)
    lower, upper = np.where(bounded, lower, -np.pi), np.where(bounded, upper, np.pi)
    return np.random.default_rng(0).uniform(lower, upper, (_FAR, len(lower)))
