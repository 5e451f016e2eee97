"""Robots and where their frames are: loading, forward kinematics, control points."""

from ._control_points import ControlPoints as ControlPoints
from ._forward import forward_kinematics as forward_kinematics
from ._forward import frame_poses as frame_poses
from ._load import load_robot as load_robot
from ._load import load_robot_from_string as load_robot_from_string
from ._panda import PANDA_MODEL as PANDA_MODEL
from ._panda import panda as panda
from ._robot import Robot as Robot
