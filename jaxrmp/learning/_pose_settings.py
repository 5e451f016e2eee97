"""How a robot follows poses of a hand that were recorded without joints."""

from collections.abc import Mapping
from dataclasses import field
from typing import Literal, get_args

import numpy as np

from .._errors import ConfigurationError, UnknownNameError
from .._pytree import set_field
from .._ranges import settings
from ..kinematics import Robot

Place = Literal["recorded", "start"]


@settings("poses")
class PoseSettings:
    """How a robot follows demonstrations of a hand's poses, see `on_robot`; not at all without a `start`.

    `start`: the posture from which inverse kinematics begins, rad or m, in the order of the robot's joints or by their
    names. `place`: where the demonstrations are, "recorded", as they were in the robot's base frame, or "start", moved
    as a whole so that on average they begin where the hand is at the start posture. `frame`: the robot's frame that
    was recorded, by default that of the subtasks.

    **Raises** `UnknownNameError` for another place.
    """

    start: Mapping[str, float] | tuple[float, ...] = field(default=(), hash=False)
    place: Place = "recorded"
    frame: str = ""

    def __post_init__(self):
        UnknownNameError.check("poses.place", self.place, get_args(Place))
        start = self.start
        set_field(self, "start", dict(start) if isinstance(start, Mapping) else tuple(float(a) for a in start))

    def posture(self, robot: Robot) -> np.ndarray:
        """The start posture [n] of `robot`.

        **Raises** `ConfigurationError` if it is not one number for each joint, within its limits; `UnknownNameError`
        for a joint that is not there.
        """
        names, start = robot.joint_names, self.start
        if isinstance(start, Mapping):
            for name in start:
                UnknownNameError.check("joint in poses.start", name, names)
            if missing := [name for name in names if name not in start]:
                raise ConfigurationError(
                    f"poses.start has no {missing}: give a value for each joint of {robot.name!r}."
                )
            start = tuple(start[name] for name in names)
        if len(start) != len(names):
            raise ConfigurationError(
                f"poses.start has {len(start)} numbers, but {robot.name!r} has {len(names)} joints: {list(names)}."
            )
        posture = np.asarray(start, float)
        for name, angle, lower, upper in zip(names, posture, robot.lower, robot.upper, strict=True):
            if not (np.isfinite(angle) and lower <= angle <= upper):
                raise ConfigurationError(
                    f"poses.start has {angle:g} for joint {name!r} of {robot.name!r}, which goes from {lower:.4g} to "
                    f"{upper:.4g}."
                )
        return posture


def example(robot: Robot | None) -> str:
    """A section [poses] to copy, whose start is the middle of the ranges of the joints of `robot`, if it is known."""
    start = ", ".join(f"{angle:.2f}" for angle in robot.middle) if robot is not None else "0.0, -0.5, 0.0"
    said = f"of {', '.join(robot.joint_names)}" if robot is not None else "of each joint"
    return (
        f'[poses]\nstart = [{start}]  # rad, {said}: a posture like that in which the motion begins\nplace = "start"  '
        '# or "recorded", as they were in the base frame'
    )
