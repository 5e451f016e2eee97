"""How recordings are to be read, where a file does not say it itself."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from .._errors import DemonstrationError, UnknownNameError
from .._ranges import NonNegative, settings
from ..kinematics import Robot
from ._demonstrations import JOINT_UNITS

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
QUATERNIONS = ("wxyz", "xyzw")


@settings("recording")
class RecordingSettings:
    """What a file of recordings leaves open; what is not given is what the file says, or asked for.

    `units`: of joints rad (sliding joints m), degrees, or normalised (-100 to 100 over the joint's range); of positions
    m, cm or mm. `group`: of a file with several the one to read, or some with commas between: a feature, a topic, a
    dataset. `columns`: the joints of the columns in their order, where the file names none, or not as the robot does.
    `rate`, samples a second, except of bags, whose stamps hold. `episodes`: those to read, by their numbers; default
    all. `quaternion` of poses of a hand: wxyz or xyzw.
    """

    units: str = ""
    group: str = ""
    columns: tuple[str, ...] = ()
    rate: NonNegative[float] = 0.0
    episodes: tuple[int, ...] = ()
    quaternion: str = ""

    def __post_init__(self):
        UnknownNameError.check("recording.units", self.units, ("", *JOINT_UNITS, *METRES))
        UnknownNameError.check("recording.quaternion", self.quaternion, ("", *QUATERNIONS))


class Open(NamedTuple):
    """A setting that a file may leave open: what it has `said` of it, what is `allowed`, a `hint` for who is asked."""

    said: str
    allowed: Sequence[str]
    hint: str = ""


def stated(recording: RecordingSettings, where: object, **settings: Open) -> tuple[str, ...]:
    """Each of `settings`, by its name: as `recording` has it, else as the file at `where` has said.

    **Raises** `DemonstrationError` that asks for all that neither says.
    """
    values = {name: str(getattr(recording, name) or of.said) for name, of in settings.items()}
    asked = []
    for name, (_, allowed, hint) in settings.items():
        if (value := values[name]) not in allowed:
            problem = f"{name} {value!r} cannot be" if value else f"nothing says the {name}"
            asked.append(
                f"{problem} of these recordings{f' ({hint})' * bool(hint)}. Say --{name} (recording.{name}) "
                f"{' or '.join(allowed)}."
            )
    if asked:
        raise DemonstrationError(f"{where}: {' And '.join(asked)}")
    return tuple(values.values())


def chosen_episodes(recording: RecordingSettings, numbers: Sequence[int], where: object) -> list[int]:
    """Those of the `numbers` of a file's episodes that are to be read. **Raises** `DemonstrationError`."""
    if absent := sorted(set(recording.episodes) - set(numbers)):
        there = f"{numbers[0]} to {numbers[-1]}" if numbers else "none"
        raise DemonstrationError(f"{where} has no episode {absent[0]} (recording.episodes); it has {there}.")
    return [number for number in numbers if not recording.episodes or number in recording.episodes]


def choose_groups(
    groups: Mapping[str, Sequence[str] | int],
    recording: RecordingSettings,
    robot: Robot | None,
    usual: str,
    where: object,
) -> list[str]:
    """Which `groups` of columns to read, given by their joints' names, or how many they are where they have none.

    Those that are named in `recording`; else those with joints of the `robot`, if none of its joints is in two; else
    the `usual` one; else the only one. **Raises** `DemonstrationError`, listing them, if that does not settle it.
    """
    if recording.group:
        named = [name.strip() for name in recording.group.split(",")]
        for name in named:
            UnknownNameError.check(f"group of joints in {where}", name, groups)
        return named
    if not groups:
        raise DemonstrationError(f"{where} holds no joint positions that are known as such.")
    if robot is not None:
        wanted = set(robot.joint_names)
        shared = {name: wanted & set(js) for name, js in groups.items() if not isinstance(js, int) and wanted & set(js)}
        if set().union(*shared.values()) == wanted and sum(map(len, shared.values())) == len(wanted):
            return list(shared)
    if usual in groups:
        return [usual]
    if len(groups) == 1:
        return list(groups)
    listed = "; ".join(
        f"{name} ({js} columns)" if isinstance(js, int) else f"{name} {list(js)}" for name, js in groups.items()
    )
    raise DemonstrationError(
        f"{where} holds several groups of joints: {listed}. Say which with --group NAME (recording.group), or name "
        "several with commas between."
    )


def name_columns(
    chosen: Sequence[str],
    groups: Mapping[str, Sequence[str] | int],
    recording: RecordingSettings,
    robot: Robot | None,
    where: object,
    told: list[str],
) -> tuple[str, ...]:
    """The joints of the columns of the `chosen` groups: of `recording.columns`, else as the file has them.

    Columns without names are the joints of the `robot` in its order if they are as many, which is `told`.
    **Raises** `DemonstrationError` if `recording.columns` are not as many.
    """
    names: list[str] = []
    for name in chosen:
        joints = groups[name]
        names += [f"{name}[{k}]" for k in range(joints)] if isinstance(joints, int) else joints
    if recording.columns:
        if len(recording.columns) != len(names):
            raise DemonstrationError(
                f"recording.columns names {len(recording.columns)} columns, but {', '.join(chosen)} of {where} has "
                f"{len(names)}: {names}."
            )
        return recording.columns
    if robot is not None and len(names) == robot.num_joints and all(isinstance(groups[name], int) for name in chosen):
        told.append(
            f"{', '.join(chosen)} names no joints: its {len(names)} columns are taken for {list(robot.joint_names)}, "
            "in this order. If they are not, name them: recording.columns."
        )
        return robot.joint_names
    return tuple(names)


def in_natural_order(name: str | Path) -> list[tuple[int, str]]:
    """A key to sort names by with their numbers as numbers: demo_10 after demo_2."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", str(name)) if part]
