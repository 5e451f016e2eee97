"""Robots from MJCF and URDF files, read by MuJoCo's own compiler."""

import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import RobotError
from .._rotations import rotation_of_quaternion
from ._couplings import resolve_couplings
from ._mujoco import import_mujoco, read_spec
from ._robot import Body, Frame, Joint, KinematicModel, Robot

_NOT_KINEMATIC = (
    *("keys", "tuples", "numerics", "texts", "sensors", "actuators", "pairs", "excludes", "skins", "flexes"),
    *("geoms", "cameras", "lights", "meshes", "hfields", "materials", "textures", "tendons"),
)


def load_robot(path: str | os.PathLike, *, fixed: Mapping[str, float] | None = None, name: str | None = None) -> Robot:
    """Read a robot from the MJCF or URDF file at `path`.

    Only the kinematics is read: meshes need not be there, links need no inertia. Joints may be revolute, prismatic
    or fixed, several to a body, in branching trees; fixed links and sites stay as frames. Mimic joints (URDF
    `mimic`, MJCF `equality/joint`) follow their leader and have no coordinate; the leader's own limits count.

    **Arguments**: `fixed`, joints to lock and the positions to lock them at, rad or m (locking a mimic joint locks
    its leader); `name`, the robot's name, by default the model's own.
    **Returns** a `Robot`. Velocity limits come from URDF's `limit velocity`; where there is none they are infinite.
    **Raises** `RobotError` if the file cannot be read or holds a ball, free or planar joint, a closed loop, or a
    non-linear coupling; `UnknownNameError` if `fixed` names a joint that is not there.
    """
    spec, path = read_spec(path), Path(path)
    return _robot_of_spec(import_mujoco(), spec, path.read_bytes(), str(path), fixed, name, str(path.resolve()))


def load_robot_from_string(xml: str, *, fixed: Mapping[str, float] | None = None, name: str | None = None) -> Robot:
    """Read a robot from the text of an MJCF or URDF file, `xml`; the rest as `load_robot`."""
    mujoco = import_mujoco()
    try:
        spec = mujoco.MjSpec.from_string(xml)
    except ValueError as error:
        raise RobotError(f"the text cannot be read as MJCF or URDF: {error}") from error
    return _robot_of_spec(mujoco, spec, xml.encode(), "the text", fixed, name)


def _robot_of_spec(mujoco, spec, text, source, fixed, name, file=None) -> Robot:
    loops = _strip(mujoco, spec)
    try:
        m = spec.compile()
    except ValueError as error:
        raise RobotError(f"{source} does not compile: {error}") from error

    bodies = tuple(
        Body(
            m.body(i).name or f"body_{i}",
            int(m.body_parentid[i]) if i else -1,
            _numbers(m.body_pos[i]),
            _numbers(rotation_of_quaternion(m.body_quat[i])),
        )
        for i in range(m.nbody)
    )
    joints = [_joint(mujoco, m, i, bodies, source) for i in range(m.njnt)]
    joints, joint_names, lower, upper = resolve_couplings(joints, m, dict(fixed or {}), source)
    model = KinematicModel(name or spec.modelname, joint_names, bodies, tuple(joints), _frames(m, bodies), file)
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
    velocity = _urdf_velocity_limits(text, source)
    return Robot(
        lower=np.array(lower),
        upper=np.array(upper),
        velocity_limit=np.array([velocity.get(joint, np.inf) for joint in joint_names]),
        model=model,
    )


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
    for body in spec.bodies[1:]:  # any inertia that compiles: it does not matter here, and the file's may be absent
        body.explicitinertial = True
        body.mass, body.inertia, body.fullinertia = 1.0, [1.0, 1.0, 1.0], [np.nan] * 6
        body.ipos, body.iquat, body.ialt.type = [0, 0, 0], [1, 0, 0, 0], mujoco.mjtOrientation.mjORIENTATION_QUAT
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.compiler.fusestatic = False
    spec.compiler.settotalmass = -1
    return loops


def _joint(mujoco, m, i: int, bodies, source: str) -> Joint:
    body = int(m.jnt_bodyid[i])
    name = m.joint(i).name or f"joint_{i}"
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


def _urdf_velocity_limits(text: bytes, source: str) -> dict[str, float]:
    """The `limit velocity` of each URDF joint, which MuJoCo drops; entries that are not positive are skipped."""
    if not re.search(rb"<robot[\s>]", text):
        return {}
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise RobotError(f"{source} is not well-formed XML: {error}") from error
    limits = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        given = limit.get("velocity", "0") if limit is not None else "0"
        try:
            velocity = float(given)
        except ValueError as error:
            raise RobotError(
                f"{source}: joint {joint.get('name')!r} has velocity limit {given!r}, expected a number."
            ) from error
        if velocity > 0.0:
            limits[joint.get("name", "")] = velocity
    return limits


def _numbers(array: Any) -> Any:
    """Python floats; what is within rounding error of an integer becomes it, so that zeros and ones can be skipped."""
    values = [float(v) for v in np.ravel(array)]
    return tuple(float(round(v)) + 0.0 if abs(v - round(v)) < 1e-14 else v for v in values)
