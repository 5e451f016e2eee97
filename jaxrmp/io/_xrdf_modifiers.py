"""What an XRDF changes in a robot's frames: some that it adds, and the one that it takes for the base."""

import numpy as np

from .._errors import UnknownNameError
from .._rotations import pose, rotation_of_quaternion
from ..kinematics import Robot, forward_kinematics, mounted, with_tool
from ..kinematics._robot import Frame
from ._yaml import Setting


def modified(robot: Robot, modifiers: list[Setting]) -> Robot:
    """`robot` with the frames that `modifiers` add, in the base frame that they set, in their order.

    **Raises** `ConfigurationError`, by key and line, for a frame that is there already, a joint that is not fixed, and
    a base that moves; `UnknownNameError` for a frame that is not there or a modifier that is not XRDF's.
    """
    for modifier in modifiers:
        for name, value in modifier.keys([], ["add_frame", "set_base_frame"]).items():
            robot = _with_frame(robot, value) if name == "add_frame" else _at_base(robot, value)
    return robot


def _with_frame(robot: Robot, setting: Setting) -> Robot:
    keys = setting.keys(["frame_name", "parent_frame_name", "fixed_transform"], ["joint_name", "joint_type"])
    name = keys["frame_name"].text()
    if name in robot.frame_names:
        keys["frame_name"].fail(f"frame {name!r} is in the URDF, or was added, already")
    if "joint_type" in keys and (kind := keys["joint_type"].text()).upper() != "FIXED":
        keys["joint_type"].fail(f"only FIXED frames can be added, not {kind}; write that joint into the URDF")
    parent = _frame(robot, keys["parent_frame_name"])
    transform = keys["fixed_transform"].keys(["position", "orientation"])
    turn = transform["orientation"].keys(["w", "xyz"])
    quaternion = np.array([turn["w"].number(), *turn["xyz"].numbers(3)])
    length = np.linalg.norm(quaternion)
    if abs(length - 1) > 1e-2:
        transform["orientation"].fail(f"expected a unit quaternion, received one of length {length:.4g}")
    T = pose(np.array(transform["position"].numbers(3)), rotation_of_quaternion(quaternion / length))
    return with_tool(robot, name, parent.name, T)


def _at_base(robot: Robot, setting: Setting) -> Robot:
    frame = _frame(robot, setting)
    above = [joint for joint in robot.model.joints if joint.body in robot.model.path(frame.body)]
    moving = [joint.name for joint in above if joint.coordinate >= 0]
    if moving:
        setting.fail(f"frame {frame.name!r} is moved by joints {moving}, and a base stands still: lock them, by "
                     "leaving them out of cspace")  # fmt: skip
    T = np.linalg.inv(np.asarray(forward_kinematics(robot, np.zeros(robot.num_joints), frame.name), float))
    return robot if np.allclose(T, np.eye(4), atol=1e-9) else mounted(robot, T)


def _frame(robot: Robot, setting: Setting) -> Frame:
    hint = f"{setting.source} names it in line {setting.line}."
    UnknownNameError.check("frame", setting.text(), robot.frame_names, hint)
    return robot.model.frames[robot.frame_index(setting.text())]
