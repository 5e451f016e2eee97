"""NVIDIA's RMPflow policies, from the files that their tools read."""

import dataclasses
import os

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import ConfigurationError, ShapeError, UnknownNameError
from .._pytree import pytree, static
from .._tree import Batched, Leaf, Node, batched, pullback
from .._trust_region import resolve_within
from ..kinematics import ControlPoints, FrameAxes, Robot
from ..leaves import lula
from ..world import ObstacleDistances, RobotSpheres, Spheres, World
from ._axes_and_position import AxesAndPosition
from ._rmpflow_yaml import read_rmpflow
from ._xrdf import read_xrdf
from ._xrdf_joints import load_with_defaults
from ._xrdf_modifiers import modified


@pytree
class LulaPolicy:
    """A policy of NVIDIA's Lula or cuMotion, as its files describe it; `tree` gives it targets and a world.

    Its leaves are fields, and their gains parameters: change them with `dataclasses.replace`. Targets in them stand
    for none. On the joints of `robot`: `cspace_target`, `cspace_inertia`, `joint_limit`, `joint_velocity_cap`; on
    `frame`, None if the files name none: `position_target`, `axis_target`, `damping`, `damping_inertia`; on distances:
    `collision`, `self_collision` and, or None, `point_cloud_collision`, of up to `max_num_points` of radius
    `point_cloud_margin`, m. `max_acceleration_norm` and `projection_tolerance` are of `resolve_within`. `spheres` are
    the robot's own for obstacles; the `controllers` keep off the capsules of `base`, which stand in the robot's base
    frame. `inactive` names what the files set and no policy here acts on.
    """

    robot: Robot
    cspace_target: lula.CSpaceTarget
    cspace_inertia: lula.Inertia
    joint_limit: lula.JointLimit
    joint_velocity_cap: lula.JointVelocityCap
    position_target: lula.PositionTarget
    axis_target: lula.AxisTarget
    collision: lula.Collision
    self_collision: lula.Collision
    point_cloud_collision: lula.Collision | None
    point_cloud_margin: jax.Array | float
    damping: lula.SpeedDamping
    damping_inertia: lula.Inertia
    spheres: RobotSpheres
    controllers: RobotSpheres
    base: World
    max_acceleration_norm: jax.Array | float
    projection_tolerance: jax.Array | float
    frame: str | None = static(default=None)
    max_num_points: int = static(default=0)
    inactive: tuple[str, ...] = static(default=())

    def tree(
        self,
        *,
        frame: str | None = None,
        position_target: jax.Array | None = None,
        x_axis_target: jax.Array | None = None,
        y_axis_target: jax.Array | None = None,
        z_axis_target: jax.Array | None = None,
        cspace_target: jax.Array | None = None,
        world: World | None = None,
        point_cloud: jax.Array | None = None,
    ) -> Node:
        """The policy for these targets in this world, a node on the robot's joints.

        **Arguments**: `frame`, which the targets are for, by default the first of the XRDF's tool frames;
        `position_target` [3], m, where its origin shall be; `x_axis_target`, `y_axis_target`, `z_axis_target` [3], unit
        vectors, where its axes shall point; `cspace_target` [n], the posture, by default the XRDF's; `world`, the
        obstacles; `point_cloud` [N, 3], m, points that count as spheres of the file's margin, padded with points far
        away, or NaN, to keep N: what is not finite is ignored, and `world.ignored_in(tree)` counts it. All of them in
        the robot's base frame, and what is left out does not act.
        **Raises** `ShapeError`, `UnknownNameError` for a frame, `ConfigurationError` for an axis target that is not of
        unit length, a point cloud that the files have no leaf for, or one larger than they allow.
        """
        posture = self.cspace_target
        if cspace_target is not None:
            target = _vector(cspace_target, self.robot.num_joints, "cspace_target")
            posture = dataclasses.replace(posture, target=target)
        node: Node = posture + self.cspace_inertia + self.joint_limit + self.joint_velocity_cap
        given = enumerate((x_axis_target, y_axis_target, z_axis_target))
        axes = {a: _unit(target, f"{'xyz'[a]}_axis_target") for a, target in given if target is not None}
        if position_target is not None:
            position_target = _vector(position_target, 3, "position_target")
        if axes or position_target is not None:
            frame = frame or self.frame
            if frame is None:
                raise ConfigurationError("the XRDF has no tool_frames: say which frame the targets are for, frame=...")
            self.robot.frame_index(frame)
            here: Node = self.damping + self.damping_inertia
            if position_target is not None:
                here = dataclasses.replace(self.position_target, target=position_target) + here
            node += pullback(ControlPoints(self.robot, (frame,)), Batched(here, shared=True))
        if frame is not None and axes:
            leaf = dataclasses.replace(self.axis_target, position_target=position_target)
            turns = (dataclasses.replace(leaf, target=target) for target in axes.values())
            space = FrameAxes if position_target is None else AxesAndPosition
            node += pullback(space(self.robot, frame, tuple(axes)), batched(*turns))
        if self.controllers.size and self.base.size:
            node += self._avoid(self.controllers, self.base, self.self_collision)
        if world is not None and world.size and self.spheres.size:
            node += self._avoid(self.spheres, world, self.collision)
        if point_cloud is not None and self.spheres.size:
            if self.point_cloud_collision is None:
                raise ConfigurationError(
                    "the configuration has no point_cloud_obstacle_rmp, so there is no leaf for points."
                )
            points = jnp.asarray(point_cloud)
            if points.ndim != 2 or points.shape[1] != 3:
                raise ShapeError(f"point_cloud has shape {points.shape}, expected (N, 3).")
            if len(points) > self.max_num_points:
                raise ConfigurationError(
                    f"point_cloud has {len(points)} points, max_num_obstacles of the file allows "
                    f"{self.max_num_points}. Thin it out, or raise the number."
                )
            cloud = Spheres(points, jnp.full(points.shape[:1], self.point_cloud_margin, points.dtype))
            node += self._avoid(self.spheres, World(spheres=cloud), self.point_cloud_collision)
        return node

    def acceleration(self, tree: Node, q: jax.Array, qd: jax.Array) -> jax.Array:
        """The joint acceleration of `tree`, resolved by `resolve_within` the file's `max_acceleration_norm`.

        **Arguments**: `tree`, as from `tree`; `q`, `qd` [n], in the order of `robot.joint_names`.
        **Returns** `qdd` [n], per second squared.
        """
        return resolve_within(tree(q, qd), self.max_acceleration_norm, self.projection_tolerance)

    def _avoid(self, spheres: RobotSpheres, world: World, leaf: Leaf) -> Node:
        return pullback(ObstacleDistances(spheres.points(self.robot), world, spheres.radii), leaf)


def load_lula(urdf: str | os.PathLike, xrdf: str | os.PathLike, rmpflow_yaml: str | os.PathLike) -> LulaPolicy:
    """Read a policy of NVIDIA's Lula or cuMotion from its three files.

    Joints outside the XRDF's `cspace` are locked at its `default_joint_positions`; its `modifiers` add frames and set
    the base. Meshes need not be there. What the files say and no policy acts on is in a `FileWarning`; if no sphere is
    left for obstacles, in an `UnsafeFileWarning`.

    **Arguments**: `urdf`, the robot; `xrdf`, its description, with the spheres for obstacles; `rmpflow_yaml`, the
    constants of the leaves.
    **Returns** a `LulaPolicy`: its `tree` takes targets and a world, as docs/lula.md shows by an example that is run.
    **Raises** `UnknownNameError` for a key, frame or joint that is not there, `ConfigurationError` for a missing key
    and a value of a wrong type or sign, all naming key and line; `RobotError` as `load_robot`;
    `MissingDependencyError` without PyYAML.

    >>> load_lula("arm.urdf", "arm.xrdf", "arm.yaml")
    Traceback (most recent call last):
    jaxrmp._errors.ConfigurationError: arm.xrdf cannot be read: [Errno 2] No such file or directory: 'arm.xrdf'

    NVIDIA, "Lula RMPflow" and "Extended Robot Description Format"; the same numbers as cuMotion 1.1.0 to rounding.
    """
    description = read_xrdf(xrdf)
    robot, defaults = load_with_defaults(urdf, description, str(xrdf))
    robot = modified(robot, description.modifiers)
    cspace = description.joint_names.texts()
    settings = read_rmpflow(rmpflow_yaml, len(cspace))
    for name, setting in (*description.lines.items(), *settings.controller_lines.items()):
        hint = f"{setting.source} names it in line {setting.line}."
        UnknownNameError.check("frame", name, robot.frame_names, hint)
    posture = np.array([defaults[name] for name in robot.joint_names])
    buffers = settings.joint_limit_buffers[[cspace.index(name) for name in robot.joint_names]]
    robot.check_ranges(robot.lower + buffers, robot.upper - buffers)
    gains = {name: dict(section) for name, section in settings.gains.items()}
    cspace_inertia, damping_inertia = gains["cspace_target_rmp"].pop("inertia"), gains["damping_rmp"].pop("inertia")
    cloud = gains.get("point_cloud_obstacle_rmp")
    margin, most = (cloud.pop("margin"), int(cloud.pop("max_num_obstacles"))) if cloud else (0.0, 0)
    count = len(settings.controllers)
    return LulaPolicy(
        robot=robot,
        cspace_target=lula.CSpaceTarget(posture, **gains["cspace_target_rmp"]),
        cspace_inertia=lula.Inertia(cspace_inertia, name="cspace_inertia"),
        joint_limit=lula.JointLimit(robot.lower + buffers, robot.upper - buffers, **gains["joint_limit_rmp"]),
        joint_velocity_cap=lula.JointVelocityCap(**gains["joint_velocity_cap_rmp"]),
        position_target=lula.PositionTarget(np.zeros(3), **gains["target_rmp"]),
        axis_target=lula.AxisTarget(np.zeros(3), **gains["axis_target_rmp"]),
        collision=lula.Collision(**gains["collision_rmp"]),
        self_collision=lula.Collision(**gains["collision_rmp"], name="self_collision"),
        point_cloud_collision=lula.Collision(**cloud, name="point_cloud_collision") if cloud else None,
        point_cloud_margin=margin,
        damping=lula.SpeedDamping(**gains["damping_rmp"]),
        damping_inertia=lula.Inertia(damping_inertia, name="damping_inertia"),
        spheres=description.world_spheres,
        controllers=RobotSpheres(
            tuple(settings.controllers), np.zeros((count, 3)), np.array(list(settings.controllers.values()))
        ),
        base=World(capsules=settings.capsules),
        max_acceleration_norm=settings.max_acceleration_norm,
        projection_tolerance=settings.projection_tolerance,
        frame=next(iter(description.tool_frames), None),
        max_num_points=most,
        inactive=settings.inactive,
    )


def _vector(value, size: int, name: str) -> jax.Array:
    value = jnp.asarray(value)
    if value.shape != (size,):
        raise ShapeError(f"{name} has shape {value.shape}, expected ({size},).")
    return value


def _unit(value, name: str) -> jax.Array:
    value = _vector(value, 3, name)
    if not isinstance(value, Tracer) and abs(float(jnp.linalg.norm(value)) - 1) > 1e-3:
        raise ConfigurationError(f"{name} must be a unit vector, received {np.asarray(value).tolist()}.")
    return value
