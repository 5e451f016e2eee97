"""MuJoCo, which reads robot files here and is needed for nothing else."""

import codecs
import contextlib
import os
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import FileWarning, RobotError, importing
from ._branch import name_parts
from ._meshes import known_to_mujoco, link_meshes, place_meshes
from ._packages import require_folders
from ._robot_text import format_of, read_text
from ._urdf import read_urdf


def import_mujoco() -> Any:
    """The module. **Raises** `MissingDependencyError` if it is not installed."""
    with importing("mujoco", "robots"):
        import mujoco
    return mujoco


def read_spec(
    path: str | os.PathLike,
    packages: Mapping[str, str | os.PathLike] | None = None,
    *,
    looks: bool = True,
    physics: bool = True,
) -> Any:
    """The `mujoco.MjSpec` of an MJCF or URDF file with its geometry, whose meshes must be there.

    `packages`, folders of ROS packages by their names, which are looked for round the file otherwise; `looks`, whether
    visual geometry of a URDF is wanted where there is collision geometry too; `physics`, whether the file's inertias
    are: else any that compile take their place, for the file's may be absent or impossible, and textures are left out.
    **Raises** `RobotError`, `MissingDependencyError`.
    """
    text, folders = read_text(path), require_folders(packages)
    if format_of(text, str(path)) == "mjcf":
        spec = parse_mjcf(text, str(path), path)
        meshes = {mesh.file: Path(spec.modelfiledir, spec.meshdir, mesh.file) for mesh in spec.meshes if mesh.file}
        files = {name: file for name, file in meshes.items() if file.is_file() and not known_to_mujoco(file)}
    else:
        urdf = read_urdf(text, str(path))
        for link in urdf.root.findall("link") if not physics else ():
            for inertial in link.findall("inertial"):
                link.remove(inertial)
        files = place_meshes(urdf.root, Path(path).resolve().parent, folders, looks, str(path))
        spec = parse_urdf(urdf.root, str(path))
    link_meshes(spec, files, str(path))
    for geom in spec.geoms:
        geom.info = f"{geom.info} of body {geom.parent.name!r}"  # which MuJoCo appends to its errors
    if not physics:
        set_any_inertia(spec)
        for material in spec.materials:
            material.textures = [""] * len(material.textures)
        for texture in list(spec.textures):
            spec.delete(texture)
    return spec


def parse_urdf(root: ElementTree.Element, source: str) -> Any:
    """The `mujoco.MjSpec` of a URDF file's `root` element. **Raises** `RobotError`."""
    return _parse(source, lambda spec: spec.from_string(ElementTree.tostring(root, encoding="unicode")))


def parse_mjcf(text: str, source: str, path: str | os.PathLike | None = None) -> Any:
    """The `mujoco.MjSpec` of an MJCF `text`, that of the file `path` if one is given. **Raises** `RobotError`."""
    # MuJoCo itself takes every file for UTF-8.
    if path is None or Path(path).read_bytes().removeprefix(codecs.BOM_UTF8) != text.encode():
        spec = _parse(source, lambda spec: spec.from_string(text))
        spec.modelfiledir = "" if path is None else str(Path(path).parent)
        return spec
    return _parse(source, lambda spec: spec.from_file(str(path)))


def compile_spec(spec: Any, source: str, what: str = "does not compile") -> Any:
    """The `mujoco.MjModel` of a spec. **Raises** `RobotError` that says `what` is wrong with `source`."""
    with _warnings_of_mujoco(source):
        try:
            return spec.compile()
        except (OSError, ValueError) as error:
            text = " ".join(str(error).split())
            absent = {mesh.name for mesh in spec.meshes if "opening file" in text and mesh.file and mesh.file in text}
            bodies = [geom.parent.name for geom in spec.geoms if geom.meshname in absent]
            where = f" It is a mesh of {bodies}: put it there, beside the file." if bodies else ""
            raise RobotError(f"{source} {what}: {text}{where}") from error


def set_any_inertia(spec: Any) -> None:
    """Give every body an inertia that compiles, in place of the file's."""
    mujoco = import_mujoco()
    for body in spec.bodies[1:]:
        body.explicitinertial = True
        body.mass, body.inertia, body.fullinertia = 1.0, [1.0, 1.0, 1.0], [np.nan] * 6
        body.ipos, body.iquat, body.ialt.type = [0, 0, 0], [1, 0, 0, 0], mujoco.mjtOrientation.mjORIENTATION_QUAT
    for mesh in spec.meshes:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # a flat one has no volume, and need not have
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.compiler.settotalmass = -1


def _parse(source: str, read: Callable[[Any], Any]) -> Any:
    """What `read` makes of the class of specs, bodies and joints named, so that kinematics and geometry agree."""
    with _warnings_of_mujoco(source):
        try:
            spec = read(import_mujoco().MjSpec)
        except (OSError, ValueError) as error:
            raise RobotError(f"{source} cannot be read as MJCF or URDF: {' '.join(str(error).split())}") from error
    name_parts(spec, source)
    return spec


@contextlib.contextmanager
def _warnings_of_mujoco(source: str) -> Iterator[None]:
    """MuJoCo prints its warnings, and into a file MUJOCO_LOG.TXT where it stands: make them ours."""
    mujoco, said = import_mujoco(), []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
        for message in dict.fromkeys(said):
            warnings.warn(f"{source}: MuJoCo says: {message.strip()}", FileWarning, stacklevel=5)
