"""An arm with nothing around it."""

import os

from ..kinematics import Robot, load_robot
from ._parts import arm_spec, on_panda
from ._robot_spec import robot_spec
from ._scene import Scene


def arm_alone(source: str | os.PathLike = "panda", robot: Robot | None = None) -> Scene:
    """A scene of an arm and its own base, where there is nothing to do but move.

    **Arguments**: `source`, "panda" or a robot file, MJCF, URDF or TOML; `robot`, the same as a robot, by default
    `load_robot(source)`: where it is mounted, what of it is locked and which branch of its file it is are as it says.
    **Raises** `RobotError` as `robot_spec`, or for a joint that has no motor and no force to be driven with.
    """
    if str(source) == "panda":
        spec = arm_spec()
        spec.delete(spec.geom("floor"))
        return Scene("arm alone", spec, object="", **on_panda())
    robot = robot or load_robot(source)
    return Scene("arm alone", robot_spec(robot), robot, object="")
