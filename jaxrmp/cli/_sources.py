"""Where robots and demonstrations come from, as named on the command line."""

import os
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from .._errors import ConfigurationError, DemonstrationError
from ..kinematics import Robot, idle_joints, load_robot
from ..learning import Configuration, DemonstrationSet, Skill, load_demonstrations, load_skill
from ..scenes import Scene, scene
from ..synthetic import SYNTHETIC_TASKS, synthetic_demonstrations
from ._output import tell

SYNTHETIC = "synthetic:"
RECORDED = ("units", "group", "rate", "quaternion")  # of `RecordingSettings` with an argument of their own
_NAMED = 6  # locked joints that are named


def skill_and_robot(file: str | os.PathLike, named: str | None) -> tuple[Skill, Robot]:
    """The skill of a file and the robot to run it on: the one it was learned on, or of the file that is `named`.

    The skill's configuration then names that robot. **Raises** `RobotError` if it has other kinematics.
    """
    skill = load_skill(file)
    robot = skill.load_robot(named)
    return replace(skill, configuration=replace(skill.configuration, robot=named)) if named else skill, robot


def robot_of(named: str | None, fix: list[str] | None, hand: str | None, quiet: bool = False) -> str | Robot:
    """The robot of a file for a page that moves the frame `hand`: the joints of `--fix PATTERN[=VALUE]` locked, and
    those that move no hand, which are told, unless `quiet`; or the name of the built-in robot.

    **Raises** `ConfigurationError` for a value that is no number, `UnknownNameError` for a frame that is not there,
    else as `load_robot`.
    """
    if named in (None, "panda"):
        if fix:
            raise ConfigurationError(
                "--fix is for a robot of a file: --robot FILE. The built-in Panda's fingers are locked."
            )
        return "panda"
    fixed = {}
    for given in fix or ():
        pattern, _, value = given.partition("=")
        try:
            fixed[pattern] = float(value) if value else None
        except ValueError as error:
            raise ConfigurationError(
                f"--fix {given}: {value!r} is no number. Expected PATTERN=VALUE, rad or m."
            ) from error
    robot = load_robot(named, fixed=fixed)
    idle = idle_joints(robot, hand)
    if not idle:
        return robot
    more = f", and {len(idle) - _NAMED} more" if len(idle) > _NAMED else ""
    if not quiet:
        tell(f"locked, for they move no hand: {', '.join(idle[:_NAMED])}{more}. --fix PATTERN=VALUE says where.")
    with warnings.catch_warnings():  # given once
        warnings.simplefilter("ignore")
        return load_robot(named, fixed={**dict.fromkeys(idle), **fixed})


def scene_of(named: str, skill: Skill) -> Scene:
    """The scene of a name or file, its object where the skill has it.

    **Raises** what `scenes.scene` raises, `RobotError` for another robot than the skill's, `ConfigurationError` for
    another object.
    """
    place = scene(named, T_world_object=np.asarray(skill.T_world_object, float))
    place.check_object(skill.configuration.object, skill.configuration.name)
    skill.check_robot(place.robot)
    return place


def default_demonstrations(skill: str) -> str:
    """Where the demonstrations of a skill are by default, as named on the command line.

    The folder franka/SKILL of $JAXRMP_DATA if that is set, or the file poses/SKILL.npz, else the scripted
    demonstrator's.
    """
    data = os.environ.get("JAXRMP_DATA")
    synthetic = SYNTHETIC + skill if skill in SYNTHETIC_TASKS else None
    if data:
        folder, poses = Path(data) / "franka" / skill, Path(data) / "poses" / f"{skill}.npz"
        if poses.is_file() and not folder.is_dir():
            return str(poses.resolve())
        if not folder.is_dir():
            raise DemonstrationError(
                f"JAXRMP_DATA is set, but there is no folder {str(folder)!r}. Correct it, unset it, or say where the "
                f"demonstrations are: --demos DIR{f', or --demos {synthetic}' if synthetic else ''}."
            )
        return str(folder.resolve())
    if synthetic is None:
        raise DemonstrationError(
            f"there are no default demonstrations of {skill!r}: say where they are with --demos DIR."
        )
    return synthetic


def find_demonstrations(
    named: str, configuration: Configuration | None = None, robot: Robot | None = None
) -> DemonstrationSet:
    """The demonstrations named on the command line, of a path or synthetic:TASK; that name becomes their source.

    The `configuration` says how recordings are read and which object was tracked, the `robot` which joints matter.
    """
    if named.startswith(SYNTHETIC):
        return replace(synthetic_demonstrations(named.removeprefix(SYNTHETIC)), source=named)
    if named == SYNTHETIC.removesuffix(":"):
        raise DemonstrationError(
            f"which synthetic task? Write {SYNTHETIC}TASK, TASK one of {', '.join(SYNTHETIC_TASKS)}."
        )
    known = {}
    if configuration:
        known = {"recording": configuration.recording, "robot": robot, "base": configuration.base}
        known |= {"tracked": configuration.object, "poses": configuration.followed}
    return replace(load_demonstrations(named, **known), source=str(Path(named).resolve()))


def demonstrations_of(skill: Skill, named: str | None, robot: Robot) -> DemonstrationSet:
    """The demonstrations named, or else those that the skill was learned from, with the joints of its `robot`."""
    try:
        return find_demonstrations(named or skill.source, skill.configuration, robot)
    except DemonstrationError as error:
        if named:
            raise
        raise DemonstrationError(
            f"the demonstrations that the skill was learned from are not where they were: {error} Say where they are "
            "with --demos DIR."
        ) from error
