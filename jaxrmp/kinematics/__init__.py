"""Robots and where their frames are: loading, forward kinematics, control points, frames' axes."""

from ._arranged import mounted as mounted
from ._arranged import with_tool as with_tool
from ._control_points import ControlPoints as ControlPoints
from ._forward import forward_kinematics as forward_kinematics
from ._forward import frame_poses as frame_poses
from ._frame_axes import FrameAxes as FrameAxes
from ._frame_axes import FrameRotation as FrameRotation
from ._geometric_jacobian import geometric_jacobian as geometric_jacobian
from ._hand_frame import hand_frame as hand_frame
from ._hand_frame import idle_joints as idle_joints
from ._load import load_robot as load_robot
from ._load import load_robot_from_string as load_robot_from_string
from ._moving_links import on_moving_links as on_moving_links
from ._panda import PANDA_MODEL as PANDA_MODEL
from ._panda import panda as panda
from ._position import Position as Position
from ._relative import PointsInFrame as PointsInFrame
from ._relative import RelativePoints as RelativePoints
from ._robot import Robot as Robot
from ._robot_record import RobotRecord as RobotRecord
from ._robot_record import record_from_dict as record_from_dict
from ._robot_record import record_of as record_of
from ._robot_record import record_to_dict as record_to_dict
from ._same_arm import arm_differences as arm_differences
