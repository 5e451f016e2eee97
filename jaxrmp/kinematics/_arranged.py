"""A robot where it stands and with what it holds: its base moved, a tool added."""

import dataclasses
from typing import Any

import numpy as np

from .._errors import RobotError
from .._rotations import pose
from .._task_map import check_rigid
from ._robot import Robot


def mounted(robot: Robot, T_world_base: Any) -> Robot:
    """The `robot` with its base at `T_world_base` [4, 4] of the world, m: on a table, on a wall, beside another arm.

    What stands in the world of its file moves with it. **Raises** `RigidTransformError` for a pose that is none.
    """
    T, model = check_rigid(T_world_base, "T_world_base"), robot.model
    # Body 0 is the world.
    bodies = tuple(_at(body, T @ pose_of(body)) if body.parent == 0 else body for body in model.bodies)
    frames = tuple(_at(frame, T @ pose_of(frame)) if frame.body == 0 else frame for frame in model.frames)
    return _with(robot, bodies=bodies, frames=frames)


def with_tool(robot: Robot, name: str, frame: str, T_frame_tool: Any) -> Robot:
    """The `robot` with one more frame, `name`, fixed at `T_frame_tool` [4, 4], m, in one that it has, `frame`.

    **Raises** `UnknownNameError` for a frame that is not there, `RobotError` for a name that is taken,
    `RigidTransformError` for a pose that is none.
    """
    parent = robot.model.frames[robot.frame_index(frame)]
    if name in robot.frame_names:
        raise RobotError(f"{robot.name!r} has a frame {name!r} already: give the tool another name.")
    T = pose_of(parent) @ check_rigid(T_frame_tool, "T_frame_tool")
    return _with(robot, frames=(*robot.model.frames, _at(parent._replace(name=name), T)))


def pose_of(part: Any) -> np.ndarray:
    """Where a body or frame sits in what it is fixed to, [4, 4]."""
    return pose(np.array(part.position), np.reshape(part.rotation, (3, 3)))


def _with(robot: Robot, **changed: Any) -> Robot:
    return dataclasses.replace(robot, model=dataclasses.replace(robot.model, **changed))


def _at(part: Any, T: np.ndarray) -> Any:
    return part._replace(position=tuple(T[:3, 3].tolist()), rotation=tuple(T[:3, :3].ravel().tolist()))
