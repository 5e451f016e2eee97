"""HDF5 files of robomimic and robosuite: groups data/demo_K of observations, or of MuJoCo states beside their model."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import DemonstrationError, JaxrmpError, importing
from ..kinematics import Robot
from ._demonstrations import Demonstration, DemonstrationSet, check_demonstration
from ._mujoco_states import MujocoStates
from ._recording import RecordingSettings, choose_groups, chosen_episodes, in_natural_order, name_columns

MAGIC = b"\x89HDF\r\n\x1a\n"
_STATES = "states"
_ISAAC = "states/articulation"
_SECONDS = "recording.rate, samples a second"


def read_hdf5(
    file: Path, recording: RecordingSettings, robot: Robot | None, tracked: str, told: list[str]
) -> DemonstrationSet:
    """The demonstrations demo_K of `file` in the order of K: `obs/*_joint_pos`, or joints of the MuJoCo states.

    A body `tracked` has its pose from the states, in the frame of the robot's base. **Raises** `DemonstrationError`,
    naming file and demonstration; `MissingDependencyError` without h5py.
    """
    with importing("h5py", "formats"):
        import h5py
    try:
        with h5py.File(file) as content:
            return _read(content, file, recording, robot, tracked, told)
    except JaxrmpError:
        raise
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError) as error:
        raise DemonstrationError(f"{file} is not readable as HDF5 of robomimic's layout: {error}.") from error


def _read(
    content: Any, file: Path, recording: RecordingSettings, robot: Robot | None, tracked: str, told: list[str]
) -> DemonstrationSet:
    data = content.get("data", {})
    demos = {
        int(name[5:]): data[name]
        for name in sorted(data, key=in_natural_order)
        if name[:5] == "demo_" and name[5:].isdigit()
    }
    if not demos:
        raise DemonstrationError(
            f"{file} has no groups data/demo_0, ...; it has {list(content)}. robomimic's layout is read."
        )
    numbers = chosen_episodes(recording, list(demos), file)
    first = demos[numbers[0]]
    groups = _groups(first, recording, file)
    chosen = choose_groups(groups, recording, robot, "", file)
    names = name_columns(chosen, groups, recording, robot, file, told)
    rate = recording.rate or _rate(data.attrs)
    demonstrations = []
    for number in numbers:
        demo, where = demos[number], f"{file}, demo_{number}"
        states = _states(demo, where) if tracked or not rate or chosen[0].startswith("states/") else None
        tables = [_columns(demo, name, states, where) for name in chosen]
        if len({len(table) for table in tables}) > 1:
            raise DemonstrationError(f"{where}: {', '.join(chosen)} have {[len(t) for t in tables]} rows.")
        q = np.concatenate(tables, axis=1)
        if rate:
            time = np.arange(len(q)) / rate
        elif states is not None and len(states.time) == len(q):
            time = states.time - states.time[0]
        else:
            raise DemonstrationError(f"{where}: nothing says the time: no control_freq in env_args. Say {_SECONDS}.")
        poses = {}
        if tracked:
            if states is None or len(states.time) != len(q):
                raise DemonstrationError(
                    f"{where} has no MuJoCo states with a model, from which {tracked!r} would be known."
                )
            poses[tracked] = states.object_pose(tracked, chosen[0])
        demonstration = Demonstration(time, q, poses)
        check_demonstration(demonstration, names, where)
        demonstrations.append(demonstration)
    left_out = [name for name in first.get("obs", first) if f"obs/{name}" not in chosen and name not in chosen]
    layout = (
        f"HDF5 of robomimic, {f'{rate:g} samples a second' if rate else 'time of the states'}: {', '.join(chosen)}; "
        f"left out: {', '.join(left_out) or 'nothing'}"
    )
    return DemonstrationSet(tuple(demonstrations), names, "unknown", file.name, recording.units or "rad", layout)


def _groups(demo: Any, recording: RecordingSettings, file: Path) -> dict[str, tuple[str, ...] | int]:
    """Datasets of joint positions, by their number of columns; else the joints of the MuJoCo model by robot."""
    usual = [f"obs/{name}" for name in demo.get("obs", ()) if name.endswith("joint_pos")]
    absolute = [f"{_ISAAC}/{name}/joint_position" for name in demo.get(_ISAAC, ())]  # obs are offsets from a posture
    named = [name.strip() for name in recording.group.split(",")]
    tables = [name for name in (*(absolute or usual), *named) if name in demo and getattr(demo[name], "ndim", 0) == 2]
    found: dict[str, Any] = {name: int(demo[name].shape[1]) for name in tables}
    if (not found or not set(named) <= {"", *found}) and (states := _states(demo, str(file))) is not None:
        found |= {f"states/{robot}": joints for robot, joints in states.robots.items()}
    return found


def _states(demo: Any, where: str) -> MujocoStates | None:
    model = demo.attrs.get("model_file")
    table = demo.get(_STATES)
    return None if model is None or getattr(table, "ndim", 0) != 2 else MujocoStates.read(model, table, where)


def _columns(demo: Any, name: str, states: MujocoStates | None, where: str) -> np.ndarray:
    if name.startswith("states/") and name not in demo:
        if states is None:
            raise DemonstrationError(f"{where} has no MuJoCo states with a model_file, as the first demonstration has.")
        return states.joint_positions(name.removeprefix("states/"))
    if name not in demo or demo[name].ndim != 2:
        raise DemonstrationError(f"{where} has no table {name!r}; it has {list(demo.get('obs', demo))}.")
    return np.asarray(demo[name][()], np.float64)


def _rate(attributes: Mapping[str, Any]) -> float:
    """`control_freq` of the environment's arguments, as robomimic and robosuite write them; 0 where there is none."""
    for key in ("env_args", "env_info"):
        try:
            said = json.loads(attributes.get(key, "{}"))
        except ValueError:
            continue
        arguments = said.get("env_kwargs", said) if isinstance(said, dict) else {}
        rate = arguments.get("control_freq") if isinstance(arguments, dict) else None
        if isinstance(rate, int | float) and rate > 0:
            return float(rate)
    return 0.0
