"""A configuration for what was taught, so that `jaxrmp learn` has all that it needs."""

import json
import re
from pathlib import Path

from .._files import atomic_write
from ._recorder import TARGET

_POINTS = {"hand": (0.0, 0.0, -0.06), "left": (0.0, 0.04, 0.0), "right": (0.0, -0.04, 0.0)}  # m, in the hand's frame


def write_configuration(folder: Path, robot: str, hand: str, targeted: bool, fixed: dict[str, float]) -> Path:
    """Write a configuration with three control points on the hand, a triangle that fixes its pose.

    **Arguments**: `folder` of the demonstrations; `robot`, "panda" or a file; `hand`, the frame that was dragged;
    `targeted`, whether the demonstrations have a target frame; `fixed`, the robot's locked joints.
    **Returns** the file, `FOLDER.toml` beside the folder.
    """
    name = re.sub(r"[^\w.-]", "_", folder.name).lstrip("-.") or "skill"
    robot = robot if robot == "panda" else str(Path(robot).resolve())
    lines = [f"# Learns what was taught in {folder.name}: every key is explained in docs/configuration.md."]
    lines += [f"name = {json.dumps(name)}", f"robot = {json.dumps(robot)}", "seed = 0"]
    if targeted:
        lines.append(f"object = {json.dumps(TARGET)} # the frame that was marked: the skill goes where it goes")
    if fixed:
        lines += ["", "[fixed_joints]", *(f"{json.dumps(name)} = {value}" for name, value in fixed.items())]
    lines += ["", "[preprocessing]", "gap = 0.3 # s: on a busy machine a page is drawn a few times a second only"]
    for point, offset in _POINTS.items():
        lines += ["", "[[subtasks]]", f"name = {json.dumps(point)}", f"frame = {json.dumps(hand)}"]
        lines.append(f"offset = {list(offset)} # m")
    path = folder.with_name(folder.name + ".toml")
    with atomic_write(path) as file:
        file.write(("\n".join(lines) + "\n").encode())
    return path
