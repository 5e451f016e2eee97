"""Where a mesh is that a URDF file names: `package://`, `model://` and `file://`, or a path."""

import os
import re
import urllib.parse
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from pathlib import Path

from .._errors import RobotError
from ._robot_file import line_of_robot_file, toml_key


def find_mesh(reference: str, folder: Path, packages: Mapping[str, str], mesh_folder: str = "") -> Path | None:
    """The file that `reference` means in a URDF of `folder`, or None if there is none.

    A package is a folder given in `packages`, else looked for from `folder` upwards (by its folder's name, there or
    beside it, or by its package.xml), then in ROS_PACKAGE_PATH and AMENT_PREFIX_PATH. A path is relative to
    `mesh_folder` (of the file's `mujoco` element) or `folder`; its last part alone will do, as for MuJoCo.
    """
    reference = reference.strip().replace("\\", "/")
    scheme = re.match(r"(package|model|file)://(.*)", reference)
    if scheme is None:
        places = (folder / mesh_folder, folder)
        candidates: Iterator[Path] = (place / path for path in (reference, Path(reference).name) for place in places)
    elif scheme[1] == "file":
        candidates = iter([folder / urllib.parse.unquote(scheme[2])])
    else:
        name, _, rest = scheme[2].partition("/")
        candidates = (place / rest for place in _places_of_package(name, folder, packages))
    return next((path.resolve() for path in candidates if path.is_file()), None)


def require_folders(packages: Mapping[str, str | os.PathLike] | None) -> dict[str, str]:
    """The `packages` as absolute paths. **Raises** `RobotError` for one that is no folder."""
    for name, folder in (packages or {}).items():
        if not Path(folder).is_dir():
            raise RobotError(f"packages[{name!r}] is {str(folder)!r}, which is no folder.")
    return {name: str(Path(folder).resolve()) for name, folder in (packages or {}).items()}


def advice(reference: str, source: str) -> str:
    """What to do about a mesh of the file `source` that is not there."""
    scheme = re.match(r"(package|model)://([^/]*)", reference)
    if scheme is None:
        return "Put it there, beside the file"
    said = line_of_robot_file(f'{toml_key("packages", scheme[2])} = "FOLDER"', source)
    return (
        f"Say where the package is: {said}; in Python, load_robot(path, packages={{{scheme[2]!r}: folder}}). Or name "
        "the folder above it in ROS_PACKAGE_PATH, or put the robot's file into it"
    )


def _places_of_package(name: str, folder: Path, packages: Mapping[str, str]) -> Iterator[Path]:
    if name in packages:
        yield Path(packages[name])
        return
    for above in (folder, *folder.parents):
        if above.name == name or _name_in_manifest(above) == name:
            yield above
        yield above / name
    for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"), ("GAZEBO_MODEL_PATH", "")):
        for entry in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            place = Path(entry) / below
            yield from (place / name, *place.glob(f"*/{name}"))
            if place.name == name or _name_in_manifest(place) == name:
                yield place
            yield from (m.parent for m in place.glob("*/package.xml") if _name_in_manifest(m.parent) == name)


def _name_in_manifest(folder: Path) -> str | None:
    try:
        found = ElementTree.parse(folder / "package.xml").findtext("name")
    except (OSError, ElementTree.ParseError):
        return None
    return found and found.strip()
