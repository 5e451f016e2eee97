"""What is looked for: an object of rigid parts on joints, with their shapes."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import NoGeometryError, RobotError, UnknownNameError
from .._pytree import pytree, set_field, static
from .._rotations import pose, rotation_of_quaternion
from ..kinematics import Robot
from ..kinematics._body_poses import body_poses
from ..kinematics._mujoco import import_mujoco
from ..kinematics._robot import Body, Frame, Joint, KinematicModel
from ..world import Boxes, Capsules, Cylinders, Spheres, World, geometry_of_model, grid_of_mesh
from ._grids import of_one_shape
from ._surface_points import surface_points

_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


_DRAWN = 3  # the first group of geometries that MuJoCo does not draw unless asked


@pytree
class ObjectModel:
    """An articulated object: n joints, links, and on each link shapes in its frame.

    `robot`, its joints and links, in the frame of its base; `links`, the indices of the bodies that have shapes, body 0
    being the base; `shapes`, a `World` for each of them, in the body's frame; `middle` [3], a point of the base's frame
    about which it turns as it is looked for; `look`, for each link points [K, S, 3] in its frame on and round its
    surfaces, K sets of S: where one looks for it in a picture.

    Make it with `object_model`.
    """

    robot: Robot
    links: tuple[int, ...] = static()
    shapes: tuple[World, ...]
    middle: Any
    look: tuple[Any, ...]

    def __post_init__(self):
        set_field(self, "links", tuple(self.links))
        if len(self.links) != len(self.shapes) or len(self.links) != len(self.look) or not self.links:
            raise RobotError(
                f"an object with {len(self.links)} links, {len(self.shapes)} worlds of shapes and {len(self.look)} "
                "sets of points: expected one a link."
            )

    @property
    def num_joints(self) -> int:
        """Number n of joints."""
        return self.robot.num_joints


def object_model(
    source: str | os.PathLike | Any,
    body: str = "world",
    points: int = 4000,
    *,
    margin: float = 0.03,
    sets: int = 16,
    seed: int = 0,
    spacing: float | None = None,
) -> ObjectModel:
    """The object that is the `body` of a MuJoCo model and all below it; the body itself is the base.

    Of an MJCF what is drawn counts (groups 0 to 2; of a body without such, all), whether it collides or not. Of a URDF
    what is only looks counts, of a link without such what collides. A joint of the base itself is left out.

    **Arguments**: `source`, a `mujoco.MjModel`, a `Scene.model` say, or an MJCF or URDF file; `body`, by default all
    that is in the file; `points`, how many pixels are looked at in a picture; `margin`, how far beyond the surfaces,
    m; `sets`, from picture to picture others, so many times; `seed`, of these; `spacing`, m, of the grids of signed
    distances that stand for meshes, by default none.
    **Raises** `UnknownNameError` for a body that is not there, `RobotError` for joints that are neither hinges nor
    slides, `NoGeometryError` for no shapes, or ellipsoids, planes, height fields, and, without `spacing`, meshes: give
    an object of boxes, capsules, cylinders and spheres.
    """
    urdf = isinstance(source, str | os.PathLike) and Path(source).suffix == ".urdf"
    m = geometry_of_model(source, looks=True) if isinstance(source, str | os.PathLike) else source
    names = [m.body(i).name or f"body_{i}" for i in range(m.nbody)]
    UnknownNameError.check("body", body, names)
    root = names.index(body)
    below = [root]
    for b in range(root + 1, m.nbody):
        if int(m.body_parentid[b]) in below:
            below.append(b)
    robot = _robot(m, names, below)
    geoms = [looks_of(m, b) if urdf else _drawn(m, b) for b in below]
    links = [k for k, found in enumerate(geoms) if found]
    if not links:
        raise NoGeometryError(f"body {body!r} has no geometry that a camera could see.")
    shapes = [shapes_of_geoms(m, geoms[k], spacing) for k in links]
    return model_of_shapes(robot, links, shapes, points, margin, sets, seed)


def looks_of(m: Any, body: int, looks: bool = True) -> list[int]:
    """Geometry of a `body` that a camera sees: what is only looks, or else, without `looks`, what collides, first."""
    geoms = [int(g) for g in np.flatnonzero(m.geom_bodyid == body) if m.geom_rgba[g, 3] > 0]
    wanted = [g for g in geoms if bool(m.geom_contype[g] or m.geom_conaffinity[g]) != looks]
    return wanted or geoms


def _drawn(m: Any, body: int) -> list[int]:
    geoms = [int(g) for g in np.flatnonzero(m.geom_bodyid == body) if m.geom_rgba[g, 3] > 0]
    return [g for g in geoms if m.geom_group[g] < _DRAWN] or geoms


def model_of_shapes(
    robot: Robot, links: Sequence[int], shapes: Sequence[World], points: int, margin: float, sets: int, seed: int
) -> ObjectModel:
    """The object with `shapes` on `links` of a `robot`, and where to look for it; the rest as `object_model`."""
    shapes = of_one_shape(shapes)
    # Links that joints move get half of the points together, since on them there is less to see.
    moves = [bool(robot.model.joints_above(k)) for k in links]
    share = [1 / max(moves.count(True), 1) if moving else 1 / max(moves.count(False), 1) for moving in moves]
    counts = np.floor(points * np.array(share) / sum(share)).astype(int)
    counts[0] += points - counts.sum()
    rng = np.random.default_rng(seed)
    look = [
        surface_points(world, sets * int(n), margin, rng).reshape(sets, int(n), 3).astype(np.float32)
        for world, n in zip(shapes, counts, strict=True)
    ]
    at = body_poses(robot.model, np.clip(np.zeros((1, robot.num_joints)), robot.lower, robot.upper))
    cloud = [p.reshape(-1, 3) @ at[k][0, :3, :3].T + at[k][0, :3, 3] for k, p in zip(links, look, strict=True)]
    return ObjectModel(robot, tuple(links), tuple(shapes), np.concatenate(cloud).mean(0), tuple(look))


def _robot(m: Any, names: list[str], below: list[int]) -> Robot:
    mujoco = import_mujoco()
    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE): "revolute", int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic"}
    bodies = [Body(names[below[0]], -1, (0.0, 0.0, 0.0), _IDENTITY)]
    joints, limits = [], []
    for b in below[1:]:
        rotation = tuple(rotation_of_quaternion(m.body_quat[b]).ravel().tolist())
        bodies.append(Body(names[b], below.index(int(m.body_parentid[b])), tuple(m.body_pos[b].tolist()), rotation))
        for i in range(m.body_jntadr[b], m.body_jntadr[b] + m.body_jntnum[b]):
            kind: Any = kinds.get(int(m.jnt_type[i]))
            if kind is None:
                raise RobotError(
                    f"joint {m.joint(i).name or i!r} of body {names[b]!r} is neither a hinge nor a slide. A joint of "
                    "the object's base is left out: name that body, if this is it."
                )
            axis, anchor = tuple(m.jnt_axis[i].tolist()), tuple(m.jnt_pos[i].tolist())
            reference, place = float(m.qpos0[m.jnt_qposadr[i]]), len(joints)
            name = m.joint(i).name or f"joint_{i}"
            joints.append(Joint(name, len(bodies) - 1, kind, axis, anchor, reference, place, 1.0, 0.0))
            limits.append(m.jnt_range[i].tolist() if m.jnt_limited[i] else [-np.inf, np.inf])
    frames = [Frame(body.name, k, (0.0, 0.0, 0.0), _IDENTITY) for k, body in enumerate(bodies)]
    model = KinematicModel(names[below[0]], tuple(j.name for j in joints), tuple(bodies), tuple(joints), tuple(frames))
    lower, upper = np.reshape(limits, (-1, 2)).T
    return Robot(lower, upper, np.full(len(joints), np.inf), model)


def shapes_of_geoms(m: Any, geoms: list[int], spacing: float | None) -> World:
    """The shapes of some geometry of a body, in its frame: of meshes one grid with points `spacing` apart, m."""
    kinds = import_mujoco().mjtGeom
    rows: dict[str, list] = {"boxes": [], "capsules": [], "cylinders": [], "spheres": []}
    corners, faces, count = [], [], 0
    for g in geoms:
        kind, size = kinds(m.geom_type[g]), m.geom_size[g]
        T = pose(m.geom_pos[g], rotation_of_quaternion(m.geom_quat[g]))
        if kind == kinds.mjGEOM_BOX:
            rows["boxes"].append((T, size))
        elif kind == kinds.mjGEOM_CAPSULE:
            along = size[1] * T[:3, 2]
            rows["capsules"].append((T[:3, 3] - along, T[:3, 3] + along, size[0]))
        elif kind == kinds.mjGEOM_CYLINDER:
            rows["cylinders"].append((T, size[0], size[1]))
        elif kind == kinds.mjGEOM_SPHERE:
            rows["spheres"].append((T[:3, 3], size[0]))
        elif kind == kinds.mjGEOM_MESH and spacing is not None:
            k = m.geom_dataid[g]
            vertices = m.mesh_vert[m.mesh_vertadr[k] :][: m.mesh_vertnum[k]].astype(float)
            corners.append(vertices @ T[:3, :3].T + T[:3, 3])
            faces.append(m.mesh_face[m.mesh_faceadr[k] :][: m.mesh_facenum[k]] + count)
            count += len(vertices)
        else:
            raise NoGeometryError(
                f"geometry {m.geom(g).name or g!r} of body {m.body(int(m.geom_bodyid[g])).name!r} is a "
                f"{kind.name.removeprefix('mjGEOM_').lower()}: an object is of boxes, capsules, cylinders and spheres"
                f"{' and meshes' if spacing is not None else ', or, with a spacing for their grids, of meshes'}."
            )
    makers: dict[str, Any] = {"boxes": Boxes, "capsules": Capsules, "cylinders": Cylinders, "spheres": Spheres}
    found: dict[str, Any] = {name: makers[name].of(found) for name, found in rows.items() if found}
    if corners:
        found["grids"] = (grid_of_mesh(np.concatenate(corners), np.concatenate(faces), spacing or 0.0),)
    return World(**found)
