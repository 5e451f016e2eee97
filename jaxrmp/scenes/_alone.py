"""An arm with nothing around it."""

import os

from ..kinematics import Robot, load_robot
from ..kinematics._mujoco import read_spec
from ._parts import arm_spec, on_panda
from ._scene import Scene


def arm_alone(source: str | os.PathLike = "panda", robot: Robot | None = None) -> Scene:
    """A scene of an arm and its own base, where there is nothing to do but move.

    **Arguments**: `source`, "panda" or an MJCF file whose joints have a motor each; `robot`, the same as a robot, by
    default `load_robot(source)`.
    **Raises** `RobotError` for a file that is none, or whose arm cannot be driven.
    """
    if str(source) == "panda":
        spec = arm_spec()
        spec.delete(spec.geom("floor"))
        return Scene("arm alone", spec, object="", **on_panda())
    robot, spec = robot or load_robot(source), read_spec(source)
    for key in list(spec.keys):
        spec.delete(key)
    return Scene("arm alone", spec, robot, object="")
