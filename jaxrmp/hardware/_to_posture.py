"""The policy that takes an arm to a posture: to where a skill starts."""

from typing import Any

import numpy as np

from ..kinematics import Robot
from ..policies import ArmPolicy, damping, joint_limits, posture, self_avoidance, velocity_limits
from ..world import RobotSpheres

_NATURAL = 2.0  # 1/s: critically damped


def to_posture(robot: Robot, rest: Any, spheres: RobotSpheres | None = None) -> ArmPolicy:
    """Takes all joints of `robot` to `rest` [n], off the arm itself and within its limits; certified. What stands
    around the arm it does not know, but for obstacles that are told.

    Where `rest` is beyond a joint's limit, as recorded postures may be a little, the joint goes to the limit.
    **Arguments**: `spheres` that cover the robot, None to keep off nothing. **Raises** as `policies.posture`.
    """
    gains = {"weight": 1.0, "stiffness": _NATURAL**2, "damping_rate": 2.0 * _NATURAL}
    rest = np.asarray(rest, float)
    if rest.shape == (robot.num_joints,):
        rest = np.clip(rest, robot.lower, robot.upper)
    always = posture(robot, rest, **gains) + joint_limits(robot) + velocity_limits(robot) + damping()
    if spheres is not None:
        always = self_avoidance(robot, spheres) + always
    return ArmPolicy(robot, (), always, spheres and spheres.moving(robot))
