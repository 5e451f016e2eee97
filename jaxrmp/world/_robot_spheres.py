"""Spheres that cover a robot, made from the geometry of its own model."""

import math
import os
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from .._errors import ConfigurationError, NoGeometryError, UnknownNameError
from .._pytree import pytree, set_field, static
from .._ranges import Finite, NonNegative, require_number
from .._rotations import rotation_of_quaternion
from ..kinematics import ControlPoints, Robot
from ..kinematics._mujoco import compile_spec, import_mujoco, read_spec
from ._cover import MOST, TooFineError, cover_alike, cover_capsule, cover_polytopes, rough_count
from ._cover_cache import cover_file, read_cover, write_cover
from ._polytopes import Polytope, box, cylinder, ellipsoid, hull

_known: dict[int, dict[tuple, Any]] = {}  # geometry by the identity of a robot's kinematic model


@pytree
class RobotSpheres:
    """K spheres fixed to a robot's frames, as `ControlPoints` and the distances take them.

    `frames`, the K frames; `offsets` [K, 3], the centres in them, m; `radii` [K], m; `coverage_error`, how far the
    spheres stick out of the geometry that they cover at most, m (NaN where that is not known). Every point of the
    geometry lies in a sphere.

    **Raises** `ConfigurationError` for a negative radius or unequal numbers.

    >>> from jaxrmp.kinematics import panda
    >>> spheres = RobotSpheres(("panda_hand", "panda_link4"), np.zeros((2, 3)), np.array([0.1, 0.12]))
    >>> jax.eval_shape(spheres.points(panda()), np.zeros(7)).shape
    (2, 3)
    """

    frames: tuple[str, ...] = static()
    offsets: jax.Array | np.ndarray
    radii: NonNegative[Finite[jax.Array | np.ndarray]]
    coverage_error: float = static(default=math.nan)

    def __post_init__(self):
        set_field(self, "frames", tuple(self.frames))
        offsets, radii = np.shape(self.offsets), np.shape(self.radii)
        if offsets != (len(self.frames), 3) or radii != (len(self.frames),):
            raise ConfigurationError(
                f"{len(self.frames)} frames with offsets of shape {offsets} and radii of shape {radii}: expected one "
                "row and one radius a frame."
            )

    @property
    def size(self) -> int:
        """Number K of spheres."""
        return len(self.frames)

    def without(self, *frames: str) -> "RobotSpheres":
        """The spheres but those on `frames`: a base, say, which touches the floor that it stands on.

        **Raises** `UnknownNameError` for a frame without spheres, `ConfigurationError` if none is left.
        """
        for name in frames:
            UnknownNameError.check("frame with spheres", name, tuple(dict.fromkeys(self.frames)))
        rows = [i for i, name in enumerate(self.frames) if name not in frames]
        if not rows:
            raise ConfigurationError(f"no sphere is left without those on {sorted(set(frames))}.")
        return self.rows(rows)

    def moving(self, robot: Robot) -> "RobotSpheres":
        """The spheres that some joint of `robot` moves, perhaps none: others, of a base or a link that turns about its
        own axis, can avoid nothing, and may touch what they stand on."""
        rows = [
            i for i, (name, at) in enumerate(zip(self.frames, self.offsets, strict=True)) if _moves(robot, name, at)
        ]
        return self.rows(rows)

    def rows(self, rows: Sequence[int]) -> "RobotSpheres":
        """The spheres of the indices `rows`, perhaps none."""
        rows = list(rows)
        frames = tuple(self.frames[i] for i in rows)
        return RobotSpheres(frames, self.offsets[rows], self.radii[rows], self.coverage_error)

    def points(self, robot: Robot) -> ControlPoints:
        """The task map from joint positions of `robot` to the centres [K, 3]. **Raises** `UnknownNameError`."""
        return ControlPoints(robot, self.frames, self.offsets)


def spheres_from_model(
    source: str | os.PathLike | Robot | Any,
    max_error: float = 0.01,
    *,
    frames: Sequence[str] | None = None,
    packages: Mapping[str, str | os.PathLike] | None = None,
) -> RobotSpheres:
    """Cover the geometry of an MJCF or URDF file with spheres, as few as are found in a few seconds.

    Each link's geometry that can collide is covered; of a link that has none, all its geometry, its look. Spheres and
    capsules are covered one by one, other solids of a link, and of links rigidly joined to it, together: a sphere on
    one link may cover a part of the other. Meshes are covered as their convex hulls, which is how MuJoCo collides them.
    Geometry of the world itself, and planes and height fields fixed to it, are scenery and left out. Spheres are kept
    on disk, in `JAXRMP_CACHE` or `~/.cache/jaxrmp`, by what they were found from.

    **Arguments**: `source`, the file (its meshes must be there), a `Robot` that was read from one, or a
    `mujoco.MjModel`; `max_error`, how far spheres may stick out of the geometry, m: the smaller, the more spheres;
    `frames`, the bodies to cover, by default all; `packages`, see `load_robot`.
    **Returns** `RobotSpheres` whose frames are bodies; its `coverage_error` is the largest protrusion there is.
    **Raises** `RobotError` if the file cannot be read, `NoGeometryError` if there is nothing to cover,
    `ConfigurationError` if `max_error` is not positive, asks for too many spheres, or `frames` names a body without
    geometry.
    """
    require_number("spheres_from_model", "max_error", max_error)
    read = isinstance(source, str | os.PathLike | Robot)
    model = geometry_of_model(source, packages) if read else source
    return cover_model(model, max_error, frames, str(source.source if isinstance(source, Robot) else source))


def geometry_of_model(
    source: str | os.PathLike | Robot,
    packages: Mapping[str, str | os.PathLike] | None = None,
    *,
    looks: bool = False,
) -> Any:
    """The compiled MuJoCo model of a file, `source`, with all its bodies and geometry, for what needs no physics: every
    body has the same inertia, and textures are left out.

    `source` may be a `Robot` that was read from a file, of which the same model is given each time, not to be changed:
    its meshes are read once; `packages`, see `load_robot`, by default the robot's; `looks`, whether a URDF's visual
    geometry is wanted, too, of links that have collision geometry.
    **Raises** `RobotError` if the file, or a mesh that it names, is not there or cannot be read, `NoGeometryError` for
    a robot that was read from text.
    """
    if isinstance(source, Robot):
        if source.source is None:
            raise NoGeometryError(
                f"{source.name!r} was read from no file that could have its geometry: load it from one or pass spheres."
            )
        file, packages = source.source, dict(source.model.packages) | dict(packages or {})
        asked = (*sorted(packages.items()), looks)
        known = _known.setdefault(id(source.model), {})
        if not known:  # as long as the robot is there, for files may change before it is loaded again
            weakref.finalize(source.model, _known.pop, id(source.model), None)
        if asked not in known:
            known[asked] = geometry_of_model(file, packages, looks=looks)
        return known[asked]
    spec = read_spec(source, packages, looks=looks, physics=False)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    return compile_spec(spec, str(source), "cannot be read with its geometry")


def _moves(robot: Robot, frame: str, offset: Any) -> bool:
    """Whether a joint moves a point of a frame: one on the axes of all revolute joints above it stays where it is."""
    model, at = robot.model, robot.model.frames[robot.frame_index(frame)]
    p = np.reshape(at.rotation, (3, 3)) @ np.asarray(offset, float) + at.position
    for body in reversed(model.path(at.body)):
        for joint in (model.joints[i] for i in reversed(model.joints_of_body[body])):
            held = joint.coordinate < 0 and joint.offset == joint.reference
            on_axis = joint.kind == "revolute" and np.allclose(np.cross(joint.axis, p - joint.anchor), 0, atol=1e-9)
            if not held and not on_axis:
                return True
        p = np.reshape(model.bodies[body].rotation, (3, 3)) @ p + model.bodies[body].position
    return False


def cover_model(m: Any, max_error: float, only: Sequence[str] | None, source: str, most: int = MOST) -> RobotSpheres:
    """The spheres of a `mujoco.MjModel` called `source` in messages, `most` at most; found anew only if not yet known.

    **Raises** as `spheres_from_model`.
    """
    bodies = bodies_with_geometry(m)
    if missing := set(only or ()) - set(bodies.values()):
        raise ConfigurationError(
            f"{source} has no geometry for {sorted(missing)}. Bodies with: {sorted(bodies.values())}."
        )
    chosen = {b: name for b, name in bodies.items() if only is None or name in only}
    geoms = {b: _geometry(m, b) for b in chosen}
    if not any(geoms.values()):
        raise NoGeometryError(f"{source} has no geometry to cover with spheres.")
    file = cover_file(m, float(max_error), sorted(chosen), most)
    found = read_cover(file)
    if found is None:
        try:
            found = _cover_groups(m, _rigid_groups(m, chosen), geoms, max_error, most)
        except TooFineError:
            found = {}
        write_cover(file, **found)
    if not found:
        raise TooFineError(max_error, most)
    names = tuple(bodies[int(b)] for b in found["owner"])
    return RobotSpheres(names, found["offsets"], found["radii"], float(found["error"]))


def bodies_with_geometry(m: Any) -> dict[int, str]:
    """The bodies of a `mujoco.MjModel` that have geometry to cover, by their indices."""
    return {int(b): m.body(b).name or f"body_{b}" for b in np.unique(m.geom_bodyid) if b > 0 and _geometry(m, b)}


def _geometry(m, body: int) -> list[int]:
    """What is covered of a link: its geometry that collides, if it has such, else all; none of planes and the like."""
    kinds = import_mujoco().mjtGeom
    covered = {*_solids(kinds), kinds.mjGEOM_SPHERE, kinds.mjGEOM_CAPSULE}
    own = [g for g in np.flatnonzero(m.geom_bodyid == body).tolist() if kinds(m.geom_type[g]) in covered]
    return [g for g in own if m.geom_contype[g] or m.geom_conaffinity[g]] or own


def _rigid_groups(m, bodies) -> list[list[int]]:
    groups: dict[int, list[int]] = {}
    for b in bodies:
        groups.setdefault(int(m.body_weldid[b]), []).append(b)
    return list(groups.values())


def _solids(kinds) -> dict[Any, Callable]:
    return {
        kinds.mjGEOM_MESH: _hull_of_mesh,
        kinds.mjGEOM_SDF: _hull_of_mesh,
        kinds.mjGEOM_BOX: lambda m, g, _: box(m.geom_size[g]),
        kinds.mjGEOM_CYLINDER: lambda m, g, _: cylinder(*m.geom_size[g][:2]),
        kinds.mjGEOM_ELLIPSOID: lambda m, g, _: ellipsoid(m.geom_size[g]),
    }


def _hull_of_mesh(m, g: int, max_error: float) -> Polytope:
    mesh = m.geom_dataid[g]
    points = m.mesh_vert[m.mesh_vertadr[mesh] :][: m.mesh_vertnum[mesh]].astype(float)
    return hull(points, 0.02 * max_error)


def _cover_groups(m, groups, geoms, max_error: float, most: int) -> dict[str, np.ndarray]:
    """Covers of links rigidly joined: body of each sphere, centre in it, radius, and the error."""
    found, left = {}, 1.3 * most
    for k in sorted(range(len(groups)), key=lambda k: -_extent(m, groups[k], geoms)):  # large ones tell soonest
        found[k] = parts, solids, _ = _parts(m, groups[k], geoms, max_error)
        left -= sum(len(radii) for _, _, radii, _ in parts)
        if solids and most < MOST:
            left -= rough_count(solids, max_error, left)
        if left < 0:
            raise TooFineError(max_error, most)
    covers, known = [], []
    for parts, solids, homes in (found[k] for k in range(len(groups))):
        covers += parts
        if solids:
            cover = cover_alike(solids, known, max_error) or cover_polytopes(solids, max_error, most)
            known.append((solids, cover))
            centers, radii, error = cover
            owner = np.array(homes)[np.argmax([solid.depth(centers) for solid in solids], axis=0)]
            for body in sorted(set(owner.tolist())):
                rotation, position = _pose(m, body)
                rows = owner == body
                covers.append((owner[rows], (centers[rows] - position) @ rotation, radii[rows], error))
        if sum(len(radii) for _, _, radii, _ in covers) > most:
            raise TooFineError(max_error, most)
    owners, offsets, radii, errors = zip(*covers, strict=True)
    owner, offsets, radii = map(np.concatenate, (owners, offsets, radii))
    return dict(owner=owner, offsets=offsets, radii=radii, error=np.array(max(errors)))


def _extent(m, group: list[int], geoms: dict[int, list[int]]) -> float:
    return max((m.geom_rbound[g] for body in group for g in geoms[body]), default=0.0)


def _parts(m, group: list[int], geoms: dict[int, list[int]], max_error: float) -> tuple[list, list, list]:
    """Covers of a group's capsules and spheres, each by itself; its other solids, and the bodies of these."""
    kinds = import_mujoco().mjtGeom
    makers, parts, solids, homes = _solids(kinds), [], [], []
    for body in group:
        for g in geoms[body]:
            kind, rotation, position = kinds(m.geom_type[g]), rotation_of_quaternion(m.geom_quat[g]), m.geom_pos[g]
            if kind in makers:
                solids.append(makers[kind](m, g, max_error).moved(rotation, position).moved(*_pose(m, body)))
                homes.append(body)
                continue
            half_length = m.geom_size[g][1] if kind == kinds.mjGEOM_CAPSULE else 0.0
            centers, radii, error = cover_capsule(m.geom_size[g][0], half_length, max_error)
            parts.append((np.full(len(radii), body), position + centers @ rotation.T, radii, error))
    return parts, solids, homes


def _pose(m, body: int) -> tuple[np.ndarray, np.ndarray]:
    """Of a body, in the first of those that it is rigidly joined to."""
    rotation, position = np.eye(3), np.zeros(3)
    while body != m.body_weldid[body]:
        own = rotation_of_quaternion(m.body_quat[body])
        rotation, position = own @ rotation, own @ position + m.body_pos[body]
        body = m.body_parentid[body]
    return rotation, position
