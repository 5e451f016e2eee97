"""A robot as it was loaded, as a MuJoCo model: its branch alone, where it is mounted, locked joints held, motors."""

import warnings
from typing import Any

import numpy as np

from .._errors import FileWarning, RobotError, UnsafeFileWarning
from .._rotations import pose, quaternion_of_rotation, rotation_of_quaternion
from ..kinematics import Robot
from ..kinematics._arranged import pose_of
from ..kinematics._body_poses import joint_motion
from ..kinematics._mujoco import compile_spec, import_mujoco, read_spec
from ..kinematics._robot_text import format_of, read_text
from ._may_touch import let_neighbours_touch


def robot_spec(robot: Robot) -> Any:
    """The editable MuJoCo model, a `mujoco.MjSpec`, of a `robot` that was read from a file, for a scene to be built on.

    As `load_robot` was told: what is no part of the robot is left out, it stands where it is mounted, locked joints are
    held where they are locked, tools are sites. Each joint has a motor: the file's own, one within the force range of
    another actuator, in whose place it is (a `FileWarning`), or one within URDF's `effort`. An `UnsafeFileWarning` says
    which joints' torques nothing limits. An MJCF joint that has none of these stays without. Links of a URDF that are
    next to each other do not touch, nor do such as meet nearly always (a `FileWarning`); in MJCF the file says.

    **Raises** `RobotError` for a robot that was read from text, a file that cannot be read or does not compile.
    """
    if robot.source is None:
        raise RobotError(f"{robot.name!r} was read from text: physics needs its file, with masses. Load it from one.")
    spec = read_spec(robot.source, dict(robot.model.packages))
    spec.compiler.fusestatic = False
    for part in (*spec.keys, *spec.sensors):
        spec.delete(part)
    _leave_out(spec, robot)
    file = compile_spec(spec, robot.source)
    mount = _mount(robot, file)
    _hold(spec, robot, file)
    _add_tools(spec, robot)
    if not np.allclose(mount, np.eye(4), atol=1e-12):
        _move_all(spec, mount)
    urdf = format_of(read_text(robot.source), robot.source) == "urdf"
    _drive(spec, robot, urdf)
    if urdf:
        let_neighbours_touch(spec, robot)
    return spec


def _mount(robot: Robot, file: Any) -> np.ndarray:
    """How far the robot's base was moved from where the file has it, [4, 4]."""
    body = next(body for body in robot.model.bodies if body.parent == 0)
    return pose_of(body) @ np.linalg.inv(_pose_in(file, body.name))


def _pose_in(model: Any, body: str) -> np.ndarray:
    found = model.body(body)
    return pose(found.pos, rotation_of_quaternion(found.quat))


def _leave_out(spec: Any, robot: Robot) -> None:
    """Delete the bodies that are no part of the robot, and all that speaks of them."""
    names = {body.name for body in robot.model.bodies}
    gone = [body for body in spec.bodies[1:] if body.name not in names]
    highest = [body for body in gone if body.parent.name in names]  # what is below goes with them
    _forget(
        spec,
        joints={joint.name for body in gone for joint in body.joints},
        bodies={body.name for body in gone},
        sites={site.name for body in gone for site in body.sites},
    )
    for body in highest:
        spec.delete(body)


def _forget(spec: Any, **gone: set[str]) -> None:
    """Delete actuators, couplings and exclusions of the `joints`, `bodies`, `sites` and `tendons` that go."""
    t, e, o = (getattr(import_mujoco(), name) for name in ("mjtTrn", "mjtEq", "mjtObj"))
    driven = {t.mjTRN_JOINT: "joints", t.mjTRN_JOINTINPARENT: "joints", t.mjTRN_BODY: "bodies"}
    driven |= {t.mjTRN_SITE: "sites", t.mjTRN_SLIDERCRANK: "sites", t.mjTRN_TENDON: "tendons"}
    coupled, held = {e.mjEQ_JOINT: "joints", e.mjEQ_TENDON: "tendons"}, {o.mjOBJ_BODY: "bodies", o.mjOBJ_SITE: "sites"}

    def goes(kind: str | None, *names: str) -> bool:
        return not gone.get(kind or "", set()).isdisjoint(names)

    parts = [part for part in spec.actuators if goes(driven.get(part.trntype), part.target)]
    for part in spec.equalities:
        if goes(coupled.get(part.type) or held.get(part.objtype), part.name1, part.name2):
            parts.append(part)
    parts += [part for part in spec.excludes if goes("bodies", part.bodyname1, part.bodyname2)]
    for part in parts:
        spec.delete(part)


def _hold(spec: Any, robot: Robot, file: Any) -> None:
    """Put bodies where locked joints hold them, and delete these joints, and those that the robot was read without."""
    gone, joints = [], {joint.name: joint for joint in robot.model.joints}
    for body in robot.model.bodies[1:]:
        there, moved, free = spec.body(body.name), np.eye(4), []
        for element in there.joints:
            joint = joints.get(element.name)
            if joint is not None and joint.coordinate >= 0:
                free.append(element)
                continue
            gone.append(element)
            if joint is not None:
                M = joint_motion(joint, np.array([joint.offset]))[0]
                moved = moved @ M
                for before in free:  # their axes move with the body, which now sits where the locked joint holds it
                    before.axis, before.pos = M[:3, :3].T @ before.axis, M[:3, :3].T @ (before.pos - M[:3, 3])
        if not np.allclose(moved, np.eye(4), atol=1e-12):
            there.set_frame(there.parent.add_frame())
            _place(there, _pose_in(file, body.name) @ moved)
    _forget(spec, joints={joint.name for joint in gone})
    if gone and list(spec.tendons):
        names = [tendon.name for tendon in spec.tendons]
        warnings.warn(
            f"{robot.source}: joints are locked, and the tendons {names} are left out: they may span them.",
            FileWarning,
            stacklevel=5,
        )
        _forget(spec, tendons=set(names))
    for part in (*(spec.tendons if gone else ()), *gone):
        spec.delete(part)


def _place(element: Any, T: np.ndarray) -> None:
    element.pos, element.quat = T[:3, 3], quaternion_of_rotation(T[:3, :3])
    element.alt.type = import_mujoco().mjtOrientation.mjORIENTATION_QUAT


def _add_tools(spec: Any, robot: Robot) -> None:
    there = {part.name for part in (*spec.bodies, *spec.sites)}
    for frame in robot.model.frames:
        if frame.name.removeprefix("site:") not in there:
            site = spec.body(robot.model.bodies[frame.body].name).add_site(name=frame.name)
            _place(site, pose_of(frame))


def _move_all(spec: Any, T: np.ndarray) -> None:
    """Move all that stands in the world by `T` [4, 4]."""
    world = spec.worldbody
    frames = [frame for frame in spec.frames if frame.parent.name == world.name]
    parts = [*world.bodies, *world.geoms, *world.sites, *world.cameras, *world.lights, *frames]
    mount = world.add_frame()
    mount.pos, mount.quat = T[:3, 3], quaternion_of_rotation(T[:3, :3])
    for part in parts:
        if part.frame is None:
            part.set_frame(mount)


def _drive(spec: Any, robot: Robot, urdf: bool) -> None:
    """One motor a joint, within the limits that the file has; in MJCF none where it has nothing to go by."""
    mujoco, replaced, unlimited = import_mujoco(), [], []
    for name in robot.joint_names:
        given = [a for a in spec.actuators if a.target == name and a.trntype == mujoco.mjtTrn.mjTRN_JOINT]
        if len(given) == 1 and not any(int(kind) for kind in (given[0].dyntype, given[0].gaintype, given[0].biastype)):
            continue
        most = _most_torque(spec, name, given, str(robot.source))
        if not given and not urdf and np.isinf(most):
            continue  # `Scene` says what is missing
        for actuator in given:
            spec.delete(actuator)
        motor = spec.add_actuator(name=f"motor of {name}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()  # whatever the file's defaults for actuators are
        motor.gear, motor.ctrllimited, motor.forcelimited = [1, 0, 0, 0, 0, 0], *[mujoco.mjtLimited.mjLIMITED_FALSE] * 2
        if np.isfinite(most):
            motor.ctrllimited, motor.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, [-most, most]
        else:
            unlimited.append(name)
        if given:
            replaced.append(name)
    if replaced:
        warnings.warn(
            f"{robot.source}: actuators of {replaced} are no plain motors. They have motors of the same force here.",
            FileWarning,
            stacklevel=4,
        )
    if unlimited:
        warnings.warn(
            f"{robot.source}: no torque limit of {unlimited}. Say it there: URDF's effort, MJCF's forcerange.",
            UnsafeFileWarning,
            stacklevel=4,
        )


def _most_torque(spec: Any, joint: str, actuators: list[Any], source: str) -> float:
    """The largest torque that a file lets the actuators of a joint have, N m or N; infinite where it says nothing.

    **Raises** `RobotError` for a range that allows torques of one sign alone."""
    ranges = [actuator.gear[0] * np.array(actuator.forcerange) for actuator in actuators]
    ranges.append(np.array(spec.joint(joint).actfrcrange))
    if one := [sorted(r.tolist()) for r in ranges if np.any(r) and not r.min() < 0 < r.max()]:
        raise RobotError(
            f"{source}: joint {joint!r} may have torques from {one[0][0]:g} to {one[0][1]:g}: both signs are needed."
        )
    return min((float(np.abs(r).min()) for r in ranges if np.any(r)), default=np.inf)
