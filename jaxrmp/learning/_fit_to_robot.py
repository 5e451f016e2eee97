"""Demonstrations as a robot has them: its joints in its order, in radians and seconds, turns counted through."""

import warnings
from dataclasses import replace

import numpy as np

from .._errors import DemonstrationError, FileWarning
from ..kinematics import Robot
from ._demonstrations import DemonstrationSet
from ._recorded_units import check_angles, check_range, check_speed, check_time
from ._turns import one_turn_for_all, within_limits, without_wraps

_GRIPPERS = ("gripper", "finger", "jaw")


def fit_to_robot(demonstrations: DemonstrationSet, robot: Robot) -> DemonstrationSet:
    """The same `demonstrations` with the joints of `robot`, in its order, and what a recorder did to them undone.

    Columns of joints that are locked, follow others, or are none of the robot's are left out, and degrees and shares of
    a joint's range become radians (sliding joints: metres). Angles that jump by a whole turn, as of recorders that keep
    them within (-pi, pi], are counted through, and demonstrations that are whole turns off the others are brought to
    theirs, as far as the joint's limits allow. A `FileWarning` says so by demonstration, joint and sample.

    **Raises** `DemonstrationError`, by demonstration, joint and sample, for joints without a column, time stamps that
    are not in seconds, angles that are not in radians (values far beyond the limits, several turns, speeds far above
    the velocity limits), and jumps that no motion explains.
    """
    told: list[str] = []
    columns = _columns(demonstrations, robot, told)
    joints = {joint.name: joint for joint in robot.model.joints}
    limits = zip(*(np.asarray(a, float) for a in (robot.lower, robot.upper, robot.velocity_limit)), strict=True)
    times = [d.time for d in demonstrations]
    if demonstrations.units == "normalised":
        _check_shares(np.concatenate([d.q[:, columns] for d in demonstrations]), robot)
    recorded = [_in_radians(d.q[:, columns], demonstrations.units, robot, told) for d in demonstrations]
    for k, (time, q) in enumerate(zip(times, recorded, strict=True)):
        check_time(time, q, f"demonstration {k}")
    for j, (name, (lower, upper, fastest)) in enumerate(zip(robot.joint_names, limits, strict=True)):
        turns = joints[name].kind == "revolute"
        paths = [q[:, j] for q in recorded]
        places = [f"demonstration {k}: joint {name!r}" for k in range(len(paths))]
        if turns:
            for path, place in zip(paths, places, strict=True):
                check_angles(path, lower, upper, place)
            each = zip(times, paths, places, strict=True)
            paths = [without_wraps(time, path, lower, upper, fastest, place, told) for time, path, place in each]
            each = zip(paths, places, strict=True)
            paths = [within_limits(path, lower, upper, place, told) for path, place in each]
        for path, place in zip(paths, places, strict=True):
            check_range(path, lower, upper, turns, place)
        if turns:
            paths = one_turn_for_all(paths, lower, upper, places, told)
        for time, path, place in zip(times, paths, places, strict=True):
            check_speed(time, path, fastest, turns, place, told)
        for q, path in zip(recorded, paths, strict=True):
            q[:, j] = path
    if told:
        warnings.warn(f"demonstrations ({demonstrations.source}): " + " ".join(told), FileWarning, stacklevel=3)
    fitted = tuple(replace(d, q=q) for d, q in zip(demonstrations, recorded, strict=True))
    return replace(demonstrations, demonstrations=fitted, joint_names=robot.joint_names, units="rad")


def _columns(demonstrations: DemonstrationSet, robot: Robot, told: list[str]) -> list[int]:
    """The column of each of the robot's joints."""
    given, wanted = demonstrations.joint_names, robot.joint_names
    dependent = {joint.name for joint in robot.model.joints} - set(wanted)
    if missing := [name for name in wanted if name not in given]:
        raise DemonstrationError(
            f"demonstrations have joints {list(given)}, robot {robot.name!r} has {list(wanted)}. {missing} are not in "
            "the demonstrations: name them alike (recording.columns), name the group that holds them (--group), or fix "
            "them (fixed_joints). Or load the right robot."
        )
    locked = [name for name in given if name in dependent]
    if locked:
        told.append(f"the columns of {locked} are left out, since these joints are locked or follow others.")
    if foreign := [name for name in given if name not in wanted and name not in dependent]:
        told.append(
            f"the columns of {foreign} are left out, since they are no joints of robot {robot.name!r}. If one of them "
            "moves the hand, load the robot that has it."
        )
    return [given.index(name) for name in wanted]


def _check_shares(q: np.ndarray, robot: Robot) -> None:
    """**Raises** `DemonstrationError` for a joint that LeRobot normalises to 0 to 100, as grippers, not -100 to 100."""
    shares = [
        name
        for name, column in zip(robot.joint_names, q.T, strict=True)
        if any(word in name.lower() for word in _GRIPPERS) and column.min() >= 0
    ]
    if shares:
        raise DemonstrationError(
            f"joints {shares} are never below 0, as of a gripper that is normalised to 0 to 100, and -100 to 100 is "
            "read: lock them (fixed_joints), or record in degrees."
        )


def _in_radians(q: np.ndarray, units: str, robot: Robot, told: list[str]) -> np.ndarray:
    """Positions [T, n] of the robot's joints as recorded in `units`, in rad, of sliding joints in m."""
    if units == "degrees":
        kinds = {joint.name: joint.kind for joint in robot.model.joints}
        return np.where([kinds[name] == "revolute" for name in robot.joint_names], np.deg2rad(q), q)
    if units == "normalised":
        lower, upper = (np.asarray(limit, float) for limit in (robot.lower, robot.upper))
        if endless := [n for n, a in zip(robot.joint_names, np.isfinite(upper - lower), strict=True) if not a]:
            raise DemonstrationError(
                f"positions are normalised to -100 to 100 over each joint's range, but joints {endless} of robot "
                f"{robot.name!r} have no limits: record in degrees."
            )
        said = (
            "positions from -100 to 100 are taken for the range between the limits of the robot's file. If the arm was "
            "calibrated to another range, or a joint goes from 0 to 100, as LeRobot's grippers do, the angles are off: "
            "record in degrees."
        )
        if said not in told:
            told.append(said)
        return lower + (q + 100.0) / 200.0 * (upper - lower)
    return np.array(q)
