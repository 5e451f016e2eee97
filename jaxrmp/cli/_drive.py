"""`jaxrmp drive`: a skill on an arm, cycle by cycle, watched and logged."""

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from .. import hardware, learning
from .._errors import ConfigurationError, DemonstrationError, RolloutError
from .._rotations import rotation_angle
from ..kinematics import Robot, frame_poses
from ..learning import Skill
from ..policies import whole_arm_policy
from ..scenes import Scene, arm_alone
from ..world import own_spheres
from ._arms import (
    arm_of,
    check_model,
    check_writable,
    narrower,
    posture_of,
    running_until_interrupted,
    sightings_of,
    write_log,
)
from ._ending import ended_by_signals
from ._output import progress_bar, tell, write_json
from ._sources import demonstrations_of, scene_of

_GO_SPEED = 0.5  # of `to_posture`, times --speed
_FAR, _FAR_TURNED = 0.3, float(np.radians(45.0))  # m and rad from where the object was shown, beyond which that is told
_PRIORITY = 50  # of real-time scheduling
_LATE = 0.2  # s, of a simulated arm, beside which other programs run
_DRY_PERIOD = 0.1  # s between the lines of --dry-run
_DRY_LINES = 50


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    given = {name: getattr(arguments, name) for name in ("speed", "duration", "near", "keep", "late")}
    if given["late"] is None:
        given["late"] = _LATE if arguments.robot == "mujoco" else hardware.DriveSettings().late
    settings = hardware.DriveSettings(**given)
    skill = learning.load_skill(arguments.skill)
    if arguments.scene and arguments.robot != "mujoco":
        raise ConfigurationError("--scene is for --robot mujoco: leave it out.")
    robot = skill.load_robot(None)
    scene = None
    if arguments.robot == "mujoco":
        scene = scene_of(arguments.scene, skill) if arguments.scene else arm_alone(skill.configuration.robot)
        robot = scene.robot
        skill.check_robot(robot)
    shown, shown_poses = _shown(skill, robot, arguments.demos)
    start = posture_of(arguments.start, robot, shown)
    object_name = skill.configuration.object if skill.configuration.object else ""
    tracks = scene is not None and bool(scene.object)
    if object_name and not arguments.tracker and not tracks and not arguments.object_still:
        raise ConfigurationError(
            f"the skill follows the object {object_name!r}: say what tracks it, --tracker udp:PORT, or, if it stands "
            "where it was demonstrated, --object-still."
        )
    real = arguments.robot != "mujoco" and arguments.realtime == "enforce"
    priority = _PRIORITY if real else 0
    if arguments.log:
        check_writable(arguments.log)
        hardware.check_log_folder(arguments.log, robot.name, robot.joint_names, object_name)
    with running_until_interrupted() as running, progress_bar(arguments.quiet) as progress:
        progress("connecting", 0.0)
        with arm_of(arguments, scene, posture_of(arguments.at, robot, shown) if arguments.at else start) as arm:
            with ended_by_signals():  # nothing moves yet
                state = arm.read()
                if why := check_model(arm, robot, state):
                    tell(f"whether the arm's kinematics are the skill's could not be checked wholly: {why}.")
                if less := narrower(arm, robot):
                    tell(
                        f"the arm's joints turn less far than the skill's robot: {'; '.join(less)}. At those ends it "
                        "stops."
                    )
                progress("compiling", 0.2)
                policy = whole_arm_policy(skill, robot)
                law = hardware.law(policy, arm, arguments.obstacles)
            if law.backend != "c" and arm.period < 0.002:
                tell(f"the policy runs by XLA, which is slower than C: {law.reason}")
            if law.uncertified:
                tell(f"its energy is not watched: {', '.join(law.uncertified)} have none.")
            progress("waiting", 0.8)
            with sightings_of(arguments.tracker, arguments.obstacles, running) as tracked:
                sightings = tracked or _untracked(skill, arm, scene)
                if far := _far(skill, sightings.newest().T_world_object, shown_poses):
                    tell(far)
                if arguments.dry_run:
                    if not _there(state.q, start, settings.near):
                        tell(
                            "without --dry-run this is refused: the arm is not at the start. --go takes it there first."
                        )
                    print(dry_run(law, state, sightings.newest(), settings, arm.period, robot))
                    return
                if arguments.go and not _there(state.q, start, 0.5 * settings.near):
                    progress("going to the start", 0.85)
                    _go(arm, robot, start, settings, running, priority)
                hardware.check_start(arm.read().q, start, settings.near, robot.joint_names)
                progress("driving", 0.9)
                found = hardware.drive(
                    arm,
                    law,
                    sightings,
                    settings,
                    start=start,
                    interface=arguments.interface,
                    names=robot.joint_names,
                    running=running,
                    priority=priority,
                )
    _report(arguments, skill, robot, law, found, sightings, object_name)


def _shown(skill: Skill, robot: Robot, named: str | None) -> tuple[list[np.ndarray] | None, list[np.ndarray]]:
    """The demonstrated joint paths, None where they are not at hand, and where the object was in each."""
    try:
        prepared = learning.prepare(skill.configuration, robot, demonstrations_of(skill, named, robot))
    except DemonstrationError:
        if named:
            raise
        return None, []
    return list(prepared.joints.q), [np.asarray(T, float) for T in prepared.poses]


def _far(skill: Skill, T: np.ndarray, shown: list[np.ndarray]) -> str:
    """That the object at `T` is far from where it was shown, in words; empty if it is not."""
    nearest = min(
        ((float(np.linalg.norm(T[:3, 3] - S[:3, 3])), float(rotation_angle(S[:3, :3].T @ T[:3, :3]))) for S in shown),
        default=(0.0, 0.0),
    )
    if nearest[0] <= _FAR and nearest[1] <= _FAR_TURNED:
        return ""
    return (
        f"the object is said to be {100 * nearest[0]:.0f} cm and {np.degrees(nearest[1]):.0f} degrees from where it "
        f"was in any demonstration of {skill.configuration.name!r}. Is its pose in the world of the robot's model?"
    )


def _there(q: np.ndarray, start: np.ndarray, near: float) -> bool:
    return bool((np.abs(q - start) <= near).all())


def _untracked(skill: Skill, arm: Any, scene: Scene | None) -> hardware.Sightings:
    """Where the object is without a tracker: where the `scene` has it, or where it was demonstrated."""
    if scene is not None and scene.object:
        return hardware.SceneTracker(arm)
    return hardware.Fixed(np.asarray(skill.T_world_object))


def _go(
    arm: Any, robot: Robot, start: np.ndarray, settings: hardware.DriveSettings, running: Any, priority: int
) -> None:
    """Take the arm to the start, slowly. **Raises** `RolloutError` if it does not get there."""
    law = hardware.law(hardware.to_posture(robot, start, own_spheres(robot)), arm)
    slow = replace(settings, speed=_GO_SPEED * settings.speed)
    options = {"names": robot.joint_names, "running": running, "priority": priority}
    found = hardware.drive(arm, law, hardware.Fixed(np.eye(4)), slow, **options)
    if found.end == hardware.DriveEnd.INTERRUPTED:
        raise KeyboardInterrupt
    if found.end != hardware.DriveEnd.RESTED:
        raise RolloutError(f"on the way to the start: {found.reason}. It stands at {found.state.q.round(3).tolist()}.")
    hardware.check_start(found.state.q, start, settings.near, robot.joint_names)


def dry_run(
    law: hardware.Law,
    state: hardware.ArmState,
    seen: hardware.Sighting,
    settings: hardware.DriveSettings,
    period: float,
    robot: Robot,
) -> str:
    """What would be sent, from the arm's state on, if it went exactly where it is told: a line each tenth of a second.

    Nothing is sent. The object stays where it is `seen`.
    """
    q, qd, qdd = state.q.astype(float), np.zeros_like(state.q), np.zeros_like(state.q)
    lines = ["nothing is sent; velocities that would be, rad/s", "   time_s  " + "  ".join(robot.joint_names)]
    every, still = round(_DRY_PERIOD / period), 0
    obstacles = hardware.slots_of(law, seen)
    zeros = np.zeros_like(qd)
    for k in range(round(settings.duration / period)):
        at = q.astype(np.float32)
        step = law.step(seen.T_world_object, obstacles, at, at, qd, qdd, zeros, np.float32(settings.speed))
        qd, qdd = step.qd, step.qdd
        q = q + period * qd
        if not np.isfinite(qd).all():
            return "\n".join([*lines, f"at {k * period:.3f} s the policy's acceleration is not finite"])
        if k % every == 0 and k // every < _DRY_LINES:
            row = "  ".join(f"{v:>{len(name)}.3f}" for v, name in zip(qd, robot.joint_names, strict=True))
            lines.append(f"{k * period:>9.1f}  {row}")
        still = still + 1 if np.abs(qd).max() < settings.still * settings.speed and k * period > settings.hold else 0
        if still * period >= settings.hold:
            return "\n".join([*lines, f"rests after {k * period:.1f} s at {q.round(3).tolist()}"])
    return "\n".join([*lines, f"does not rest within {settings.duration:g} s"])


def _report(
    arguments: argparse.Namespace,
    skill: Skill,
    robot: Robot,
    law: hardware.Law,
    found: hardware.Drive,
    sightings: hardware.Sightings,
    object_name: str,
) -> None:
    arrays = found.log.arrays()
    report = report_dict(skill, robot, law, found, arrays)
    file = bag = None
    if arguments.log and found.log.count:
        try:
            file, bag, why = write_log(arrays, arguments.log, robot, object_name)
        except OSError as error:
            tell(f"the log could not be written: {error}")
        else:
            if why:
                tell(why)
    report |= {"log": str(file) if file else None, "mcap": str(bag) if bag else None}
    report["datagrams_not_read"] = getattr(sightings, "unread", None)
    if arguments.json:
        write_json(report, arguments.json)
    print(report_text(report))
    if unread := report["datagrams_not_read"]:
        tell(f"{unread} datagrams of the tracker could not be read: {getattr(sightings, 'why', '')}")
    if arguments.realtime == "enforce" and arguments.robot != "mujoco" and not found.real_time:
        tell("the system did not let this be scheduled in real time (SCHED_FIFO): cycles may come late.")
    if found.log.full:
        tell("the log is full: the last cycles are not in it.")
    if found.end == hardware.DriveEnd.INTERRUPTED:
        raise KeyboardInterrupt
    if found.end != hardware.DriveEnd.RESTED:
        raise RolloutError(f"stopped after {report['time_s']:.2f} s: {found.reason}.")
    far = report["goal_cm"]
    if far is not None and far > 100 * arguments.tolerance:
        raise RolloutError(
            f"it rests {far:.1f} cm from the goal, and --tolerance is {100 * arguments.tolerance:g}: something holds "
            "it up, or the goal is out of reach."
        )


def report_dict(
    skill: Skill, robot: Robot, law: hardware.Law, found: hardware.Drive, arrays: dict[str, np.ndarray]
) -> dict[str, Any]:
    """A drive in numbers: how it ended and why; where, in cm or, of a turn alone, degrees from the goal; its cycles,
    how many were late, and how long our part of them took."""
    busy = 1e6 * arrays["log_busy"][np.isfinite(arrays["log_busy"])]
    shares = (("50", 50), ("99", 99), ("99_9", 99.9))
    share = {f"p{name}": float(np.percentile(busy, p)) for name, p in shares} if len(busy) else None
    count = found.log.count
    cut = np.abs(arrays["log_accelerations_told"] - arrays["log_accelerations_wanted"]).max(axis=1) > 1e-2
    goal_cm, turn_deg = (None, None) if not count else _left(skill, robot, found.state.q, arrays["T_world_object"][-1])
    return {
        "end": found.end.value,
        "reason": found.reason,
        "time_s": float(arrays["time"][-1]) if count else 0.0,
        "goal_cm": goal_cm,
        "goal_turn_deg": turn_deg,
        "cycles": count,
        "late_cycles": int(found.late),
        "busy_us": share,
        "limited": float(np.mean(cut[~arrays["log_braking"]])) if count and not arrays["log_braking"].all() else None,
        "backend": law.backend,
        "real_time": found.real_time,
        "energy_watched": not law.uncertified,
    }


def _left(skill: Skill, robot: Robot, q: np.ndarray, T: np.ndarray) -> tuple[float | None, float | None]:
    """How far the farthest control point is from its target, cm, and of a turn alone how far the hand, degrees."""
    q, T = q.astype(float), np.asarray(T, float)
    if skill.of_turn:
        pose = np.asarray(frame_poses(robot, q, skill.frames[:1]))[0]
        return None, float(np.degrees(rotation_angle((T[:3, :3] @ np.asarray(skill.R_object_hand)).T @ pose[:3, :3])))
    points = learning.control_points(robot, skill.frames, np.asarray(skill.offsets, float), q[None])[0]
    missed = learning.in_frame(points, T) - np.asarray(skill.targets)
    return float(100 * np.linalg.norm(missed, axis=-1).max()), None


def report_text(report: dict[str, Any]) -> str:
    """`report_dict` in a few lines."""
    where = ""
    if report["goal_cm"] is not None:
        where = f", {report['goal_cm']:.2f} cm from the goal"
    elif report["goal_turn_deg"] is not None:
        where = f", turned {report['goal_turn_deg']:.1f} degrees from the goal"
    lines = [f"{report['reason']} after {report['time_s']:.2f} s{where}"]
    busy = report["busy_us"]
    took = f"; our part took {busy['p50']:.0f} us, p99.9 {busy['p99_9']:.0f}" if busy else ""
    lines.append(f"{report['cycles']:,} cycles, {report['late_cycles']} late{took}")
    if report["log"]:
        lines.append(f"log: {report['log']}" + (f" and {report['mcap']}" if report["mcap"] else ""))
    return "\n".join(lines)
