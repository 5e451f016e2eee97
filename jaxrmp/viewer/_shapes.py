"""The geometry of a MuJoCo model as triangles, body by body."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from .._errors import importing
from .._rotations import rotation_of_quaternion
from ..kinematics._mujoco import import_mujoco


class Shape(NamedTuple):
    """Triangles fixed to a body: `vertices` [V, 3], m, in the body's frame; `faces` [F, 3]; `rgba`, 0 to 1; `flat`,
    whether it has edges to be seen."""

    body: int
    vertices: np.ndarray
    faces: np.ndarray
    rgba: tuple[float, float, float, float]
    flat: bool


def shapes_of(model: Any, geoms: Iterable[int]) -> list[Shape]:
    """Triangles of some geometries of a compiled `mujoco.MjModel`, those of one body and colour as one shape.

    Planes, height fields and what is transparent altogether are left out.
    """
    parts: dict[tuple, list[tuple[np.ndarray, np.ndarray]]] = {}
    for g in geoms:
        found = _triangles(model, int(g))
        material = int(model.geom_matid[g])
        colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[g]
        rgba: Any = tuple(round(float(v), 3) for v in colour)
        if found is None or rgba[3] == 0:
            continue
        vertices, faces, flat = found
        vertices = vertices @ rotation_of_quaternion(model.geom_quat[g]).T + model.geom_pos[g]
        parts.setdefault((int(model.geom_bodyid[g]), rgba, flat), []).append((vertices, faces))
    shapes = []
    for (body, rgba, flat), pieces in parts.items():
        first = np.cumsum([0, *(len(vertices) for vertices, _ in pieces)])
        faces = np.concatenate([faces + start for (_, faces), start in zip(pieces, first, strict=False)])
        shapes.append(Shape(body, np.concatenate([v for v, _ in pieces]), faces, rgba, flat))
    return shapes


def add_shape(scene: Any, name: str, shape: Shape, color: tuple[int, int, int] | None = None, **settings: Any) -> None:
    """Put a shape on a page's `scene` as the node `name`, in its own colour unless another is given; no shadows."""
    settings = {"flat_shading": shape.flat, "cast_shadow": False, "receive_shadow": False, **settings}
    own = tuple(round(255 * v) for v in shape.rgba[:3])
    scene.add_mesh_simple(name, shape.vertices, shape.faces, color=color or own, **settings)


def seen(model: Any) -> list[int]:
    """The geometries of a robot that are there to be looked at: of each link those that collide with nothing, such as
    visual meshes, if there are any, else all."""
    links = [g for g in range(model.ngeom) if model.geom_bodyid[g] > 0]
    visual = {g for g in links if not (model.geom_contype[g] or model.geom_conaffinity[g])}
    dressed = {model.geom_bodyid[g] for g in visual}
    return [g for g in links if g in visual or model.geom_bodyid[g] not in dressed]


def _triangles(model: Any, g: int) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Vertices and faces of one geometry in its own frame, and whether it has edges; None for kinds without."""
    with importing("trimesh", "viewer"):
        from trimesh import creation
    kinds = import_mujoco().mjtGeom
    kind, (a, b, c) = kinds(model.geom_type[g]), (float(v) for v in model.geom_size[g])
    if kind == kinds.mjGEOM_MESH:
        mesh = model.geom_dataid[g]
        vertices, faces = (
            getattr(model, array)[first : first + count].copy()
            for array, first, count in (
                ("mesh_vert", model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]),
                ("mesh_face", model.mesh_faceadr[mesh], model.mesh_facenum[mesh]),
            )
        )
        return vertices.astype(float), faces, False
    if kind == kinds.mjGEOM_CAPSULE:
        solid = creation.capsule(radius=a, height=2 * b, count=(16, 16))
        solid.vertices[:, 2] -= solid.bounds[:, 2].mean()  # whichever end trimesh starts from
    elif kind == kinds.mjGEOM_BOX:
        solid = creation.box(extents=(2 * a, 2 * b, 2 * c))
    elif kind == kinds.mjGEOM_CYLINDER:
        solid = creation.cylinder(radius=a, height=2 * b, sections=32)
    elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        solid = creation.icosphere(subdivisions=3)
        solid.vertices *= (a, a, a) if kind == kinds.mjGEOM_SPHERE else (a, b, c)
    else:
        return None
    return np.asarray(solid.vertices), np.asarray(solid.faces), kind in (kinds.mjGEOM_BOX, kinds.mjGEOM_CYLINDER)
