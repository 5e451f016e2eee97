"""Robots from MJCF and URDF files, read by MuJoCo's own compiler."""

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import RobotError, UnknownNameError, UnsafeFileWarning
from .._ranges import require_number
from .._rotations import rotation_of_quaternion
from ._arranged import mounted, with_tool
from ._branch import keep_branch
from ._couplings import resolve_couplings
from ._mujoco import compile_spec, import_mujoco, parse_mjcf, parse_urdf, set_any_inertia
from ._packages import require_folders
from ._robot import Body, Frame, Joint, KinematicModel, Robot
from ._robot_file import read_robot_file
from ._robot_text import format_of, read_text
from ._srdf import read_srdf
from ._urdf import Urdf, read_urdf, warn_of

_NOT_KINEMATIC = (
    *("keys", "tuples", "numerics", "texts", "sensors", "actuators", "pairs", "excludes", "skins", "flexes"),
    *("geoms", "cameras", "lights", "meshes", "hfields", "materials", "textures", "tendons"),
)


def load_robot(
    path: str | os.PathLike,
    *,
    fixed: Mapping[str, float | None] | None = None,
    root: str | None = None,
    mount: Any = None,
    tools: Mapping[str, tuple[str, Any]] | None = None,
    name: str | None = None,
    packages: Mapping[str, str | os.PathLike] | None = None,
    ignore: Mapping[str, Sequence[str]] | None = None,
    srdf: str | os.PathLike | None = None,
    cover_error: float | None = None,
) -> Robot:
    """Read a robot from the MJCF or URDF file at `path`, or from a TOML file that names one (docs/guides/new_robot.md).

    What the arguments say is added to what a TOML file says, or replaces it.

    Only the kinematics is read: meshes need not be there, links need no inertia. Joints may be revolute, prismatic
    or fixed, several to a body, in branching trees; fixed links and sites stay as frames. Mimic joints (URDF
    `mimic`, MJCF `equality/joint`) follow their leader and have no coordinate; the leader's own limits count.

    **Arguments**: `fixed`, joints to lock, or patterns of their names such as `"*_finger_*"`, and the positions to lock
    them at, rad or m, None for the one in their range that is nearest to zero (locking a mimic joint locks its leader);
    `root`, the body that the robot begins with, where the file holds more, such as another arm: what is not above or
    below it is left out, and joints above it that `fixed` does not name stay as in the file's reference posture;
    `mount` [4, 4], where the base stands in the world, m, by default as in the file; `tools`, frames to add, as name to
    frame and pose in it [4, 4]; `name`, the robot's name, by default the model's own; `packages`, folders of ROS
    packages by name, for the meshes of `package://NAME/...` when the robot's geometry is asked for: others are looked
    for from the file upwards and in ROS_PACKAGE_PATH; `ignore`, for a frame with geometry those that it may touch,
    `srdf`, a file of MoveIt's that says so too, and `cover_error`, how far the spheres that cover the robot may stick
    out of its geometry, m: for policies that avoid collisions of the robot with itself, see `world.own_spheres` and
    `own_self_pairs`.
    **Returns** a `Robot`. Position limits are read by the format's own rule: in URDF `lower` and `upper` are 0 where
    they are absent, and a continuous joint has none. Velocity limits come from URDF's `limit velocity`; where there is
    none they are infinite, with an `UnsafeFileWarning` if the `limit` leaves it out or it is not positive.
    **Raises** `RobotError` if the file cannot be read or holds a ball, free, floating or planar joint, a closed loop, a
    non-linear coupling, one name twice, a mimic of a joint that is not there, or a revolute or prismatic joint of URDF
    without limits or with swapped ones; `UnknownNameError` if `fixed`, `root` or a tool names what is not there;
    `RigidTransformError` for a pose that is none.
    """
    if Path(path).suffix == ".toml":
        described = read_robot_file(path)
        for key, more in (("fixed", fixed), ("tools", tools), ("packages", packages), ("ignore", ignore)):
            described[key] = {**described.get(key, {}), **(more or {})}
        given = {"root": root, "mount": mount, "name": name, "srdf": srdf, "cover_error": cover_error}
        robot = load_robot(**(described | {key: value for key, value in given.items() if value is not None}))
        return replace(robot, model=replace(robot.model, robot_file=str(path)))
    text, folders = read_text(path), tuple(require_folders(packages).items())
    robot = _robot_of(text, str(path), fixed, name, root, Path(path), folders)
    if ignore or srdf or cover_error is not None:
        robot = _with_cover(robot, ignore or {}, srdf, cover_error)
    for tool, (frame, T) in (tools or {}).items():
        robot = with_tool(robot, tool, frame, T)
    return robot if mount is None else mounted(robot, mount)


def _with_cover(
    robot: Robot, ignore: Mapping[str, Sequence[str]], srdf: str | os.PathLike | None, cover_error: float | None
) -> Robot:
    """The `robot` with what is said of its collisions with itself; **raises** as `load_robot`."""
    touching = read_srdf(srdf, robot.frame_names) if srdf else {}
    pairs = [(frame, other) for frame, others in touching.items() for other in others]
    for frame, others in ignore.items():
        if isinstance(others, str) or not isinstance(others, Sequence):
            raise RobotError(f"ignore.{frame} is {others!r}, expected a list of the frames that it may touch.")
        pairs += [(frame, str(other)) for other in others]
    for frame in (frame for pair in pairs for frame in pair):
        UnknownNameError.check("frame in ignore", frame, robot.frame_names)
    require_number("load_robot", "cover_error", cover_error)
    model = replace(robot.model, ignore=tuple(pairs), cover_error=float(cover_error or 0.0))
    return replace(robot, model=model)


def load_robot_from_string(
    xml: str,
    *,
    fixed: Mapping[str, float | None] | None = None,
    root: str | None = None,
    name: str | None = None,
) -> Robot:
    """Read a robot from the text of an MJCF or URDF file, `xml`; the rest as `load_robot`."""
    return _robot_of(xml, "the text", fixed, name, root)


def _robot_of(text, source, fixed, name, root=None, path=None, packages=()) -> Robot:
    mujoco, urdf = import_mujoco(), None
    if format_of(text, source) == "urdf":
        urdf = read_urdf(text, source)
        for link in urdf.root.findall("link"):
            for part in list(link):
                link.remove(part)
        spec = parse_urdf(urdf.root, source)
    else:
        spec = parse_mjcf(text, source, path)
        _warn_of_ranges(mujoco, spec, source)
    gone = keep_branch(mujoco, spec, root, fixed or {}, source)
    if urdf is not None:
        urdf = urdf.without(gone)
    loops = _strip(mujoco, spec)
    m = compile_spec(spec, source)
    _require_numbers(m, source)
    bodies = tuple(
        Body(
            m.body(i).name,
            int(m.body_parentid[i]) if i else -1,
            _numbers(m.body_pos[i]),
            _numbers(rotation_of_quaternion(m.body_quat[i])),
        )
        for i in range(m.nbody)
    )
    joints = [_joint(mujoco, m, i, bodies, source) for i in range(m.njnt)]
    ranges = _ranges(m, joints, urdf, source)
    joints, joint_names, lower, upper = resolve_couplings(joints, m, ranges, fixed or {}, source)
    file = None if path is None else str(path.resolve())
    model = KinematicModel(
        name or spec.modelname, joint_names, bodies, tuple(joints), _frames(m, bodies), file, packages
    )
    index = {body.name: i for i, body in enumerate(bodies)}
    for loop, ends in loops:
        if ends is None:
            raise RobotError(f"{source}: equality {loop!r} couples joints by a tendon, which jaxrmp cannot express.")
        one_side, other_side = (set(model.path(index.get(end, 0))) for end in ends)
        moving = [joint.name for joint in joints if joint.body in one_side ^ other_side and joint.coordinate >= 0]
        if moving:
            raise RobotError(
                f"{source}: equality {loop!r} closes a loop through joints {moving}; jaxrmp's robots are trees. "
                f"Lock these joints, e.g. fixed={{{moving[0]!r}: 0.0, ...}}, or remove the constraint."
            )
    _warn_of_followers(joints, ranges, np.array([lower, upper]), source)
    velocity = np.full(len(joint_names), np.inf)
    if urdf is not None:
        warn_of(urdf, joint_names, source)
        velocity = np.array([urdf.joints[joint].velocity or np.inf for joint in joint_names])
    return Robot(lower=np.array(lower), upper=np.array(upper), velocity_limit=velocity, model=model)


def _strip(mujoco, spec) -> list[tuple[str, tuple[str, str]]]:
    """Delete from `spec` what is not kinematics. Returns the loop-closing constraints found, with their two bodies."""
    loops = []
    site_body = {site.name: site.parent.name for site in spec.sites}
    mocap = {body.name for body in spec.bodies if body.mocap}
    for equality in list(spec.equalities):
        if equality.type == mujoco.mjtEq.mjEQ_JOINT and equality.active:
            continue
        if equality.active and equality.type in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            ends = [end or "world" for end in (equality.name1, equality.name2)]
            if equality.objtype == mujoco.mjtObj.mjOBJ_SITE:
                ends = [site_body.get(end, end) for end in ends]
            if not mocap.intersection(ends):  # a weld to a mocap body is how simulations drag a robot about
                loops.append((equality.name or f"{ends[0]} - {ends[1]}", tuple(ends)))
        elif equality.active and equality.type == mujoco.mjtEq.mjEQ_TENDON:
            loops.append((equality.name or equality.name1, None))
        spec.delete(equality)
    for kind in _NOT_KINEMATIC:
        for element in list(getattr(spec, kind)):
            spec.delete(element)
    set_any_inertia(spec)
    spec.compiler.fusestatic = False
    return loops


def _joint(mujoco, m, i: int, bodies, source: str) -> Joint:
    body = int(m.jnt_bodyid[i])
    name = m.joint(i).name
    kinds: dict[Any, Any] = {mujoco.mjtJoint.mjJNT_HINGE: "revolute", mujoco.mjtJoint.mjJNT_SLIDE: "prismatic"}
    kind = kinds.get(mujoco.mjtJoint(m.jnt_type[i]))
    if kind is None:
        what = "free" if m.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE else "ball"
        raise RobotError(
            f"{source}: joint {name!r} of body {bodies[body].name!r} is a {what} joint; jaxrmp's robots have "
            "revolute, prismatic and fixed joints. Remove it, or replace it by revolute and prismatic joints."
        )
    reference = float(m.qpos0[m.jnt_qposadr[i]])
    return Joint(name, body, kind, _numbers(m.jnt_axis[i]), _numbers(m.jnt_pos[i]), reference, i, 1.0, 0.0)


def _frames(m, bodies) -> tuple[Frame, ...]:
    identity = _numbers(np.eye(3))
    frames = [Frame(body.name, i, (0.0, 0.0, 0.0), identity) for i, body in enumerate(bodies)]
    taken = {body.name for body in bodies}
    for i in range(m.nsite):
        name = m.site(i).name
        if name:
            name = f"site:{name}" if name in taken else name
            rotation = _numbers(rotation_of_quaternion(m.site_quat[i]))
            frames.append(Frame(name, int(m.site_bodyid[i]), _numbers(m.site_pos[i]), rotation))
    return tuple(frames)


def _ranges(m, joints: list[Joint], urdf: Urdf | None, source: str) -> list[tuple[float, float]]:
    """The position limits of every joint: those of a URDF file are its own, for MuJoCo takes some for none."""
    if urdf is None:
        return [
            (float(low), float(high)) if limited else (-np.inf, np.inf)
            for limited, (low, high) in zip(m.jnt_limited, m.jnt_range, strict=True)
        ]
    followers = [name for name, joint in urdf.joints.items() if joint.leader is not None]
    coupled = [joints[i].name for i in m.eq_obj1id]
    if {joint.name for joint in joints} != set(urdf.joints) or sorted(coupled) != sorted(followers):
        raise RobotError(
            f"{source}: MuJoCo reads the joints {[j.name for j in joints]}, of which {coupled} mimic others, but the "
            f"file has {list(urdf.joints)}, of which {followers} do. Rename or remove what is lost."
        )
    return [(urdf.joints[joint.name].lower, urdf.joints[joint.name].upper) for joint in joints]


def _require_numbers(m, source: str) -> None:
    for kind, arrays in (("body", (m.body_pos, m.body_quat)), ("joint", (m.jnt_pos, m.jnt_axis))):
        numbers = np.concatenate(arrays, axis=1)
        for i in np.flatnonzero(~np.isfinite(numbers).all(1)):
            name = getattr(m, kind)(i).name
            raise RobotError(f"{source}: the place or axis of {kind} {name!r} is not finite: {numbers[i].tolist()}.")


def _warn_of_followers(joints: list[Joint], ranges, limits: np.ndarray, source: str) -> None:
    """Warn of mimic joints that their leaders take beyond their own limits; `limits` [2, n] are the leaders'."""
    crossed = []
    for joint, (low, high) in zip(joints, ranges, strict=True):
        if joint.coordinate >= 0:
            reached = joint.multiplier * limits[:, joint.coordinate] + joint.offset
            if reached.min() < low - 1e-2 or reached.max() > high + 1e-2:
                crossed.append(joint.name)
    if crossed:
        warnings.warn(
            f"{source}: joints {crossed} follow others, whose limits count, beyond limits of their own. Narrow the "
            "leaders' limits (Robot.lower and upper, or in the file).",
            UnsafeFileWarning,
            stacklevel=4,
        )


def _warn_of_ranges(mujoco, spec, source: str) -> None:
    """Warn of ranges that stand in an MJCF file and that MuJoCo does not hold its joints to."""
    free = mujoco.mjtLimited.mjLIMITED_FALSE
    idle = [j.name for j in spec.joints if any(j.range) and (j.limited == free or not j.range[0] < j.range[1])]
    if idle:
        warnings.warn(
            f'{source}: joints {idle} have a range that is not used, for they say limited="false" or it is empty.',
            UnsafeFileWarning,
            stacklevel=4,
        )


def _numbers(array: Any) -> Any:
    """Python floats; what is within rounding error of an integer becomes it, so that zeros and ones can be skipped."""
    values = [float(v) for v in np.ravel(array)]
    return tuple(float(round(v)) + 0.0 if abs(v - round(v)) < 1e-14 else v for v in values)
