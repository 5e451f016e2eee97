"""Where robots and demonstrations come from, as named on the command line."""

import os
from pathlib import Path

from .._errors import DemonstrationError
from ..kinematics import Robot, load_robot, panda
from ..learning import Configuration, DemonstrationSet, load_demonstrations
from ..synthetic import SYNTHETIC_TASKS, synthetic_demonstrations

SYNTHETIC = "synthetic:"


def robot_of(configuration: Configuration) -> Robot:
    """The built-in Panda, or the robot of the MJCF or URDF file that the configuration names."""
    if configuration.robot == "panda":
        return panda()
    return load_robot(configuration.robot, fixed=dict(configuration.fixed_joints))


def find_demonstrations(named: str | None, skill: str) -> DemonstrationSet:
    """The demonstrations named on the command line, or the default ones of a skill.

    `named` is a folder, or `synthetic:TASK`. Without it: the folder franka/SKILL of $JAXRMP_DATA if there is one, else
    the scripted demonstrator's.
    """
    if named is None:
        recorded = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "franka" / skill
        if recorded.is_dir():
            named = str(recorded)
        elif skill in SYNTHETIC_TASKS:
            named = SYNTHETIC + skill
        else:
            raise DemonstrationError(
                f"there are no default demonstrations of {skill!r}: say where they are with --demos DIR."
            )
    if named.startswith(SYNTHETIC):
        return synthetic_demonstrations(named.removeprefix(SYNTHETIC))
    return load_demonstrations(named)
