"""The text of a robot's file: its encoding, and which of the two formats it is in."""

import codecs
import os
import re
from pathlib import Path
from typing import Literal

from .._errors import RobotError

_MARKS = (
    *((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32")),
    *((codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16")),
    *((b"<\0", "utf-16-le"), (b"\0<", "utf-16-be")),
)
_OTHERS = {
    "html": "is a web page. Download the file itself: on GitHub, the 'raw' one",
    "sdf": "is an SDF model, which is not read. Export the robot as URDF or MJCF",
    "collada": "is a mesh. Give the URDF or MJCF file that names it",
    "mujocoinclude": "is a part of an MJCF model. Give the file that includes it",
    "launch": "is a launch file. Give the robot's own file",
}


def read_text(path: str | os.PathLike) -> str:
    """The text of an XML file, in the encoding that it declares, by default UTF-8. **Raises** `RobotError`."""
    if not Path(path).is_file():
        what = "this is a folder" if Path(path).is_dir() else "there is no such file"
        raise RobotError(f"{path}: {what}. Give the path of an MJCF or URDF file.")
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise RobotError(f"{path} cannot be read: {error}") from error
    marked = next((encoding for mark, encoding in _MARKS if data.startswith(mark)), None)
    declared = re.match(rb"""\s*<\?xml[^>]*?encoding\s*=\s*["']([^"']+)["']""", data)
    encoding = marked or (declared[1].decode("ascii", "replace") if declared else "utf-8")
    if not data.strip():
        raise RobotError(f"{path} is empty and cannot be read as MJCF or URDF.")
    try:
        text = data.decode(encoding)
    except LookupError as error:
        raise RobotError(f"{path} declares the encoding {encoding!r}, which is not known. Save it as UTF-8.") from error
    except UnicodeError as error:
        raise RobotError(
            f"{path} cannot be read as MJCF or URDF: it is not {encoding.upper()} text ({error}). Save it as UTF-8, or "
            'declare its encoding in the first line, such as <?xml version="1.0" encoding="latin-1"?>.'
        ) from error
    return text.removeprefix("\ufeff")


def format_of(text: str, source: str) -> Literal["urdf", "mjcf"]:
    """Whether a text is URDF or MJCF, by its first element. **Raises** `RobotError` that says what else it is."""
    text = re.sub(r"<!--.*?-->|<\?.*?\?>", "", text, flags=re.DOTALL)
    if re.search(r"<xacro:", text):
        raise RobotError(
            f"{source} is a xacro file: its macros must be expanded first. Run `xacro FILE > robot.urdf`, where there "
            "is ROS or the PyPI package xacro, and give robot.urdf."
        )
    first = re.search(r"<\s*([\w:.-]+)", text)
    name = first[1] if first else ""
    if name == "robot":
        return "urdf"
    if name == "mujoco":
        return "mjcf"
    other = _OTHERS.get(name.lower())
    if other is None:
        begins = f"begins with <{name}>" if name else "holds no XML element"
        other = f"{begins}. URDF begins with <robot>, MJCF with <mujoco>"
    raise RobotError(f"{source} cannot be read as MJCF or URDF: it {other}.")
