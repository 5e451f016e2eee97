"""Spheres that cover a robot, made from the geometry of its own model."""

import functools
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from .._errors import ConfigurationError, RobotError, UnknownNameError
from .._pytree import pytree, set_field, static
from .._ranges import Finite, NonNegative, require_number
from .._rotations import rotation_of_quaternion
from ..kinematics import PANDA_MODEL, ControlPoints, Robot
from ..kinematics._mujoco import compile_spec, import_mujoco, read_spec
from ._cover import cover_box, cover_capsule, cover_convex_hull, cover_cylinder, cover_ellipsoid


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
    coverage_error: float = static(default=float("nan"))

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
        return self._of(rows)

    def moving(self, robot: Robot) -> "RobotSpheres":
        """The spheres that some joint of `robot` moves, perhaps none: others, of a base or a link that turns about its
        own axis, can avoid nothing, and may touch what they stand on."""
        rows = [
            i for i, (name, at) in enumerate(zip(self.frames, self.offsets, strict=True)) if _moves(robot, name, at)
        ]
        return self._of(rows)

    def _of(self, rows: list[int]) -> "RobotSpheres":
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
    """Cover the geometry of an MJCF or URDF file with spheres.

    Every geometry that can collide is covered; if there is none, every geometry. Spheres, capsules, boxes,
    cylinders and ellipsoids are covered as they are, meshes as their convex hulls, which is how MuJoCo collides them.
    Geometry fixed to the world, and planes and height fields, are scenery and left out.

    **Arguments**: `source`, the file (its meshes must be there), a `Robot` that was read from one, or a
    `mujoco.MjModel`; `max_error`, how far spheres may stick out of the geometry, m: the smaller, the more spheres (a
    solid other than a capsule or a sphere needs about its volume over the cube of this); `frames`, the bodies to cover,
    by default all; `packages`, see `load_robot`.
    **Returns** `RobotSpheres` whose frames are bodies; its `coverage_error` is the largest protrusion there is.
    **Raises** `RobotError` if the file cannot be read, `ConfigurationError` if `max_error` is not positive, asks for
    too many spheres, or `frames` names a body without geometry.
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

    `source` may be a `Robot` that was read from a file; `packages`, see `load_robot`, by default the robot's; `looks`,
    whether a URDF's visual geometry is wanted, too, of links that have collision geometry.
    **Raises** `RobotError` if the file, or a mesh that it names, is not there or cannot be read.
    """
    if isinstance(source, Robot):
        if source.source is None:
            raise RobotError(f"{source.name!r} was read from no file that could have its geometry: load it from one.")
        source, packages = source.source, dict(source.model.packages) | dict(packages or {})
    spec = read_spec(source, packages, looks=looks, physics=False)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    return compile_spec(spec, str(source), "cannot be read with its geometry")


@functools.cache
def panda_spheres(max_error: float = 0.015) -> RobotSpheres:
    """Spheres for the built-in Panda that stick out of its own geometry by `max_error`, m, at most: by default 37."""
    return spheres_from_model(PANDA_MODEL, max_error)


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


def cover_model(m, max_error, only, source) -> RobotSpheres:
    geoms = [g for g in range(m.ngeom) if m.geom_bodyid[g] > 0]
    colliding = [g for g in geoms if m.geom_contype[g] or m.geom_conaffinity[g]]
    names, offsets, radii, error = [], [], [], 0.0
    for g in colliding or geoms:
        body = int(m.geom_bodyid[g])
        name = m.body(body).name or f"body_{body}"
        found = _cover_geometry(m, g, max_error) if only is None or name in only else None
        if found is None:
            continue
        centers, sizes, stick_out = found
        offsets.append(m.geom_pos[g] + centers @ rotation_of_quaternion(m.geom_quat[g]).T)
        radii.append(sizes)
        names += [name] * len(sizes)
        error = max(error, stick_out)
    if missing := set(only or ()) - set(names):
        raise ConfigurationError(f"{source} has no geometry for {sorted(missing)}. Bodies with: {sorted(set(names))}.")
    if not names:
        raise ConfigurationError(f"{source} has no geometry to cover with spheres.")
    return RobotSpheres(tuple(names), np.concatenate(offsets), np.concatenate(radii), error)


def _cover_geometry(m, g: int, max_error: float) -> Any:
    kinds, (a, b, _) = import_mujoco().mjtGeom, m.geom_size[g]
    kind, mesh = kinds(m.geom_type[g]), m.geom_dataid[g]
    if kind == kinds.mjGEOM_MESH:
        first = m.mesh_vertadr[mesh]
        return cover_convex_hull(m.mesh_vert[first : first + m.mesh_vertnum[mesh]].astype(float), max_error)
    covers: dict[Any, tuple[Callable, tuple]] = {
        kinds.mjGEOM_SPHERE: (cover_capsule, (a, 0.0)),
        kinds.mjGEOM_CAPSULE: (cover_capsule, (a, b)),
        kinds.mjGEOM_BOX: (cover_box, (m.geom_size[g],)),
        kinds.mjGEOM_CYLINDER: (cover_cylinder, (a, b)),
        kinds.mjGEOM_ELLIPSOID: (cover_ellipsoid, (m.geom_size[g],)),
    }
    cover, sizes = covers.get(kind, (None, ()))
    return cover and cover(*sizes, max_error)
