"""A robot as a TOML file: which file it is read from, which part of it, where it stands and what it holds."""

import json
import os
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import RobotError, UnknownNameError
from .._rotations import pose, rotation_of_rpy

_KEYS = ("file", "name", "root", "fixed", "mount", "tools", "packages", "ignore", "srdf", "cover_error")
_WORDS = ("file", "name", "root", "srdf")
_NUMERIC = ("mount", "cover_error")


def read_robot_file(path: str | os.PathLike) -> dict[str, Any]:
    """The arguments of `load_robot` that the TOML file at `path` has, its `path` among them.

    `file`, MJCF or URDF, and `srdf`, found from the TOML file's folder; optional `name`, `root`, `packages`, `fixed`,
    `ignore` and `cover_error`, as `load_robot` has them; `mount`, where the base stands, and `[tools.NAME]` with
    `frame` and `pose`.
    A pose is `[x, y, z]` or `[x, y, z, roll, pitch, yaw]`, m and rad, as URDF's `xyz` and `rpy`.
    **Raises** `RobotError` for a file that is not so.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RobotError(f"{path} cannot be read as TOML: {error}") from error
    for key in content:
        UnknownNameError.check(f"key in {path}", key, _KEYS)
    for key in _KEYS:
        kind, what = (str, "a string") if key in _WORDS else (dict, "a table")
        if key not in _NUMERIC and not isinstance(content.get(key, kind()), kind):
            raise RobotError(f"{path}: {key} is {content[key]!r}, expected {what}.")
    if not content.get("file") or Path(content["file"]).suffix == ".toml":
        raise RobotError(f"{path}: file is {content.get('file')!r}, expected the path of an MJCF or URDF file.")
    for name, place in content.get("packages", {}).items():
        if not isinstance(place, str):
            raise RobotError(f"{path}: packages.{name} is {place!r}, expected a folder.")
    if type(fineness := content.get("cover_error", 1.0)) not in (int, float):
        raise RobotError(f"{path}: cover_error is {fineness!r}, expected a length, m.")
    folder = Path(path).parent
    found = {key: content[key] for key in ("name", "root", "fixed", "ignore", "cover_error") if key in content}
    found["path"] = folder / content["file"]
    if "srdf" in content:
        found["srdf"] = folder / content["srdf"]
    found["packages"] = {name: folder / place for name, place in content.get("packages", {}).items()}
    if "mount" in content:
        found["mount"] = pose_of_numbers(content["mount"], f"{path}: mount")
    tools = {}
    for name, tool in content.get("tools", {}).items():
        if not isinstance(tool, dict) or set(tool) != {"frame", "pose"}:
            raise RobotError(f"{path}: tools.{name} is {tool!r}, expected a table with frame and pose.")
        tools[name] = tool["frame"], pose_of_numbers(tool["pose"], f"{path}: tools.{name}.pose")
    return found | {"tools": tools}


def toml_key(table: str, name: str) -> str:
    """How TOML names the entry `name` of a `table`."""
    return f"{table}.{name if re.fullmatch('[A-Za-z0-9_-]+', name) else json.dumps(name)}"


def line_of_robot_file(line: str, source: str | None, robot_file: str | None = None) -> str:
    """How to say `line`, of TOML, of the robot of the MJCF or URDF file `source`, in words for an advice: in the
    `robot_file` that it was read by, if it was."""
    if robot_file is not None:
        return f"`{line}` in {robot_file}"
    file = Path(source).resolve() if source else Path("ROBOT.urdf")
    return (
        f'`{line}` in a robot file, {file.stem}.toml with the line `file = "{file.as_posix()}"`, which configurations '
        "take as robot and commands as --robot"
    )


def pose_of_numbers(numbers: Any, what: str) -> np.ndarray:
    """[4, 4] of `[x, y, z]` or `[x, y, z, roll, pitch, yaw]`, m and rad. **Raises** `RobotError`, naming `what`."""
    try:
        values = np.asarray(numbers, float)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape not in ((3,), (6,)) or not np.isfinite(values).all():
        raise RobotError(f"{what} is {numbers!r}, expected 3 or 6 numbers: x, y, z, m, and roll, pitch, yaw, rad.")
    return pose(values[:3], rotation_of_rpy(values[3:] if values.size > 3 else np.zeros(3)))
