"""The meshes of a robot's file, made ready for MuJoCo: found, under names of their own, in a form that it reads."""

import importlib.util
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import FileWarning, RobotError
from ._packages import advice, find_mesh

_MOST_FACES = 200_000  # of an STL file that MuJoCo reads


def place_meshes(
    root: ElementTree.Element, folder: Path, packages: Mapping[str, str], looks: bool, source: str
) -> dict[str, Path]:
    """Rename the meshes below a URDF's `root`, for MuJoCo takes two of one name in two folders for one.

    Visual geometry stays where a link has no other, and everywhere for `looks`; a visual mesh that is not there is then
    left out, with a warning, where its link has a collision geometry.
    **Returns** the files by their new names. **Raises** `RobotError` that names link and mesh if one is not there.
    """
    extension = root.find("mujoco")
    extension = ElementTree.SubElement(root, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
    compiler.set("discardvisual", "false")
    mesh_folder = compiler.attrib.pop("meshdir", "")
    names: dict[Path, str] = {}
    lacking: list[str] = []
    for link in root.findall("link"):
        collides = link.find("collision") is not None
        for geometry in link.findall("visual") if collides and not looks else ():
            link.remove(geometry)
        for kind in ("visual", "collision"):
            for geometry in link.findall(kind):
                geometry.attrib.pop("name", None)  # several may have one name, in URDF
                if geometry.find("geometry/*") is None:
                    raise RobotError(f"{source}: a {kind} of link {link.get('name')!r} has no geometry.")
                mesh = geometry.find("geometry/mesh")
                if mesh is None:
                    continue
                reference = mesh.get("filename", "")
                path = find_mesh(reference, folder, packages, mesh_folder)
                if path is not None:
                    mesh.set("filename", names.setdefault(path, f"mesh_{len(names)}_.stl"))
                elif kind == "visual" and collides:
                    link.remove(geometry)
                    lacking.append(f"{reference} (link {link.get('name')!r})")
                else:
                    raise RobotError(
                        f"{source}: the {kind} mesh {reference!r} of link {link.get('name')!r} is not there. "
                        f"{advice(reference, source)}."
                    )
    if lacking:
        warnings.warn(
            f"{source}: visual meshes are not there and left out: {', '.join(lacking)}. {advice(lacking[0], source)}.",
            FileWarning,
            stacklevel=4,
        )
    return {name: path for path, name in names.items()}


def link_meshes(spec: Any, files: Mapping[str, Path], source: str) -> None:
    """Have the meshes of `spec` read from `files`, by what they call their files; by trimesh what MuJoCo cannot read.

    A visual mesh that cannot be read is left out, with a warning, where its body has geometry that collides.
    **Raises** `RobotError` that names the mesh if another cannot be read.
    """
    converted: dict[Path, Any] = {}
    lacking: list[str] = []
    for mesh in list(spec.meshes):
        path = files.get(mesh.file)
        if path is None:
            continue
        mesh.info = f"{mesh.info} read from {path}"
        if known_to_mujoco(path):
            mesh.file = str(path)
            continue
        try:
            vertices, faces = converted.get(path) or converted.setdefault(path, _triangles(path))
        except RobotError as error:
            geoms = [geom for geom in spec.geoms if geom.meshname == mesh.name]
            if any(_collides(geom) or not any(map(_collides, geom.parent.geoms)) for geom in geoms):
                raise RobotError(f"{source}: {error}") from error
            for element in (*geoms, mesh):
                spec.delete(element)
            lacking.append(str(error))
        else:
            mesh.file, mesh.uservert, mesh.userface = "", vertices.ravel(), faces.ravel()
    if lacking:
        text = " ".join(dict.fromkeys(lacking))
        warnings.warn(f"{source}: visual meshes are left out: {text}", FileWarning, stacklevel=4)


def _collides(geom: Any) -> bool:
    return bool(geom.contype or geom.conaffinity)


def known_to_mujoco(path: Path) -> bool:
    """Whether MuJoCo's compiler can read a mesh file: no text in STL, and not too many faces."""
    if path.suffix.lower() != ".stl":
        return path.suffix.lower() in (".obj", ".msh")
    with path.open("rb") as file:
        head = file.read(84)
    count = int.from_bytes(head[80:84], "little")
    return path.stat().st_size == 84 + 50 * count and count <= _MOST_FACES


def _triangles(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [V, 3], m, and faces [F, 3]. As in ROS, a COLLADA file's unit counts, and its axis does not."""
    collada = path.suffix.lower() == ".dae"
    try:
        import trimesh

        if collada and importlib.util.find_spec("collada") is None:
            raise ImportError("pycollada")
        mesh: Any = trimesh.load(path, force="mesh")
        if collada and mesh.units not in (None, "meters"):
            mesh.convert_units("meters")
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32)
    except ImportError as error:
        raise RobotError(
            f"MuJoCo cannot read the mesh {path}; trimesh and pycollada can: pip install 'jaxrmp[viewer]', or, in a "
            "clone of jaxrmp, pip install -e '.[viewer]'."
        ) from error
    except Exception as error:  # trimesh's readers have many kinds of errors for damaged files
        raise RobotError(f"the mesh {path} cannot be read ({type(error).__name__}: {error}).") from error
    if len(vertices) < 4 or not np.isfinite(vertices).all():
        raise RobotError(f"the mesh {path} cannot be read: {len(faces)} triangles were found in it.")
    return vertices, faces
