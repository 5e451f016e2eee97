"""Synthetic demonstrations: scripted motions, recorded as a real arm would be."""

import os
from pathlib import Path

import numpy as np

from .._errors import DemonstrationError, UnknownNameError
from ..kinematics import panda
from ..learning._arc_length import cubic_spline
from ..learning._demonstration_files import save_demonstrations
from ..learning._demonstrations import Demonstration, DemonstrationSet
from ._inverse_kinematics import follow
from ._motion import Rotation, minimum_jerk
from ._tasks import TaskScript, door_reaching, drawer_closing

_SCRIPTS = {"drawer_closing": drawer_closing, "door_reaching": door_reaching}

SYNTHETIC_TASKS = tuple(_SCRIPTS)
"""Names of the tasks that `synthetic_demonstrations` knows."""

_RATE = 30.0  # samples a second
_JITTER = 0.001  # of a time stamp, s
_JOINT_NOISE = 5e-5  # rad
_TRACKER_NOISE = 0.003, 0.01  # of each coordinate, m, and about each axis, rad: 5 mm and 1 degree in all
_ATTEMPTS = 20  # a drawn script may be out of the arm's reach
_KNOT = 0.1  # s between the poses that inverse kinematics is solved for
_GRIPPER = np.array([0.0, 0.0, 0.207])  # centre of the gripper in panda_link7, m


def synthetic_demonstrations(task: str, seed: int = 0, count: int = 6) -> DemonstrationSet:
    """Demonstrations of a task on the built-in Panda by a script, not by a person: `source` is "synthetic".

    Several starts; overlapping minimum-jerk segments through via poses of the hand, each time a little different;
    pauses at both ends; joint positions at 30 Hz with jitter and noise. The scale is that of the paper's experiments.

    **Arguments**: `task`, `drawer_closing` (no tracked object) or `door_reaching` (with the pose of `door_handle` from
    a noisy 30 Hz tracker); the same `seed` and `count` give the same demonstrations; `count`, at least 2.
    **Raises** `UnknownNameError` for another task; `DemonstrationError` for a count below 2.
    """
    UnknownNameError.check("synthetic task", task, SYNTHETIC_TASKS)
    rng = np.random.default_rng([seed, SYNTHETIC_TASKS.index(task)])
    shift = rng.uniform(size=3)
    places = [(shift + k * np.array([0.8191725, 0.6710436, 0.5497005])) % 1.0 for k in range(count)]  # fills the cube
    recordings = [_record(task, place, rng) for place in places]
    return DemonstrationSet(tuple(recordings), panda().joint_names, panda().name, "synthetic")


def write_synthetic_demonstrations(
    task: str, path: str | os.PathLike, seed: int = 0, count: int = 6, overwrite: bool = False
) -> Path:
    """Write demonstrations by `save_demonstrations`, which says what `path` and `overwrite` are and what else can go
    wrong; the rest as `synthetic_demonstrations`."""
    return save_demonstrations(synthetic_demonstrations(task, seed, count), path, overwrite)


def _record(task: str, place: np.ndarray, rng: np.random.Generator) -> Demonstration:
    script, knots, q_knots = _perform(task, place, rng)
    motion = script.motion
    before, after = rng.uniform(0.6, 4.0, 2)
    time = np.arange(0.0, before + motion.duration + after, 1.0 / _RATE)
    time = np.maximum.accumulate(time + rng.normal(0.0, _JITTER, len(time)))
    q = cubic_spline(knots, q_knots, np.clip(time - before, 0.0, motion.duration))
    q = q + rng.normal(0.0, _JOINT_NOISE, q.shape)
    poses = {name: _tracked(T, len(time), rng) for name, T in script.object_poses.items()}
    return Demonstration(time - time[0], q, poses)


def _perform(task: str, place: np.ndarray, rng: np.random.Generator) -> tuple[TaskScript, np.ndarray, np.ndarray]:
    """A script that the arm can follow, and what it does: times [T], s, and configurations [T, 7]."""
    attempts = 0
    while True:
        script = _SCRIPTS[task](rng, place)
        motion = script.motion
        knots = np.linspace(0.0, motion.duration, round(motion.duration / _KNOT) + 1)
        positions, rotations = motion(knots)
        lean = minimum_jerk(knots / motion.duration)[:, None]
        postures = (1.0 - lean) * script.postures[0] + lean * script.postures[1]
        try:
            return script, knots, follow(panda(), "panda_link7", _GRIPPER, positions, rotations.as_matrix(), postures)
        except DemonstrationError:
            attempts += 1
            if attempts == _ATTEMPTS:
                raise


def _tracked(T: np.ndarray, samples: int, rng: np.random.Generator) -> np.ndarray:
    """A constant pose as a noisy tracker sees it: [samples, 4, 4]."""
    seen = np.tile(T, (samples, 1, 1))
    seen[:, :3, 3] += rng.normal(0.0, _TRACKER_NOISE[0], (samples, 3))
    seen[:, :3, :3] = T[:3, :3] @ Rotation.from_rotvec(rng.normal(0.0, _TRACKER_NOISE[1], (samples, 3))).as_matrix()
    return seen
