"""Demonstrations of a hand's poses as a robot does them: with joints, by inverse kinematics."""

import warnings
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DemonstrationError, FileWarning, ShapeError, UnknownNameError
from ..kinematics import Robot, forward_kinematics
from ._clear_branch import follow_clear
from ._demonstrations import Demonstration, DemonstrationSet
from ._pose_demonstrations import PoseDemonstrationSet
from ._pose_settings import Place
from ._skill import mean_pose

_TILTED = 5.0  # degrees, from which on a placement that tilts is told


def on_robot(
    poses: PoseDemonstrationSet,
    robot: Robot,
    frame: str,
    start: np.ndarray,
    base: str = "world",
    place: Place = "recorded",
) -> DemonstrationSet:
    """Demonstrations in which `frame` of `robot` follows the `poses` of a hand, by inverse kinematics from `start`.

    **Arguments**: `robot`; its `frame`, which stands for the hand that was recorded; `start` [n], rad or m, a posture
    near which the first sample of each demonstration is sought; `base`, the robot's frame in which poses are; `place`,
    "recorded", poses are there as they were recorded, or "start", all are moved as one, objects with them, so that the
    mean of their first samples is where the frame is at `start`. A `FileWarning` tells if that tilts them.
    Where the arm would overlap itself, by the spheres that `whole_arm_policy` keeps apart, it is bent otherwise if that
    helps, nearest to `start`, and a `FileWarning` tells it.
    **Returns** a `DemonstrationSet` of the robot's joints, within their limits, at the same times.
    **Raises** `DemonstrationError`, by demonstration and sample, for a pose that is missed by more than 1 mm or half a
    degree; `UnknownNameError` for a frame that is not there or another place; `ShapeError` for a start that is not [n].
    """
    UnknownNameError.check("place", place, get_args(Place))
    start = np.asarray(start, float)
    if start.shape != (robot.num_joints,):
        raise ShapeError(f"start has shape {start.shape}, expected ({robot.num_joints},): {list(robot.joint_names)}.")
    with jax.enable_x64(True):
        hand, T_world_base = (np.asarray(forward_kinematics(robot, jnp.asarray(start), name)) for name in (frame, base))
    moved = np.eye(4)
    if place == "start":
        moved = np.linalg.inv(T_world_base) @ hand @ np.linalg.inv(mean_pose(np.stack([d.hand[0] for d in poses])))
        tilt = np.degrees(np.arccos(np.clip(moved[2, 2], -1, 1)))
        if tilt > _TILTED:
            warnings.warn(
                f"poses ({poses.source}): to begin where {frame!r} is at the start posture, they are tilted by "
                f"{tilt:.0f} degrees. If what is up matters, choose a start that holds the hand as it was held.",
                FileWarning,
                stacklevel=2,
            )
    most = max(len(d.time) for d in poses)
    rows = [np.minimum(np.arange(most), len(d.time) - 1) for d in poses]  # ends wait for the longest
    wanted = np.stack([(T_world_base @ moved @ d.hand)[row] for d, row in zip(poses, rows, strict=True)])
    found = follow_clear(robot, frame, wanted, start, poses.source)
    missed = ~found.arrives
    if missed.any():
        k, i = (int(at[0]) for at in np.nonzero(missed))
        at = (np.linalg.inv(T_world_base) @ wanted[k, i])[:3, 3]
        other = "start" if place == "recorded" else "recorded"
        raise DemonstrationError(
            f"demonstration {k} ({poses.source}): {robot.name!r} cannot bring {frame!r} to the pose at sample {i}, at "
            f"{at.round(3).tolist()} in {base!r}, {np.linalg.norm(at):.2f} m from it: it is off by "
            f"{1000 * found.position[k, i]:.1f} mm and {np.degrees(found.turn[k, i]):.1f} degrees. Choose "
            f"another start posture (poses.start) or place (poses.place = {other!r}), or the frame that was recorded "
            "(poses.frame)."
        )
    demonstrations = tuple(
        Demonstration(d.time, q[: len(d.time)], {name: moved @ T for name, T in d.poses.items()})
        for d, q in zip(poses, found.q, strict=True)
    )
    layout = f"{poses.layout}; followed by {frame} of {robot.name}, {'as recorded' if place == 'recorded' else 'moved'}"
    return DemonstrationSet(demonstrations, robot.joint_names, robot.name, poses.source, layout=layout)
