"""Arms as named on the command line, signals that end what they do, and the words around them."""

import argparse
import contextlib
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .. import hardware
from .._errors import ConfigurationError
from ..kinematics import Robot, frame_poses
from ..scenes import Scene
from ._ending import heard, killed_by_signals

_MOVES = 0.1  # rad/s, above which an arm's own word of its flange may be of another moment
_SAME, _SAME_TURN = 0.005, 0.02  # m, and rad times one, by which the arm's flange may differ from the model's


@contextlib.contextmanager
def running_until_interrupted() -> Iterator[Callable[[], bool]]:
    """A function that says whether to go on: not after a signal that ends a command. It ends nothing else."""
    ended = [False]

    def end(number: int, frame: Any) -> None:
        ended[0] = True

    before = {number: signal.signal(number, end) for number in heard()}
    try:
        yield lambda: not ended[0]
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def arm_of(arguments: argparse.Namespace, scene: Scene | None, q: np.ndarray | None) -> Iterator[Any]:
    """The arm of `--robot`, hung up at the end: in a `scene` of MuJoCo at `q`, or a Franka at `--host`."""
    if arguments.robot == "franka":
        if not arguments.host:
            raise ConfigurationError("--robot franka needs --host ADDRESS, such as 172.16.0.2.")
        with killed_by_signals():  # nothing moves yet, and an address at which nobody answers is tried for a minute
            arm = hardware.FrankaArm(arguments.host, arguments.realtime)
            if arguments.recover:
                arm.recover()
    else:
        assert scene is not None and q is not None
        arm = hardware.MujocoArm(scene, q)
    try:
        yield arm
    finally:
        arm.close()


@contextlib.contextmanager
def sightings_of(
    named: str | None, obstacles: int, running: Callable[[], bool]
) -> Iterator[hardware.UdpSightings | None]:
    """What `--tracker udp:PORT` or `udp:HOST:PORT` listens to, once a pose is there, until the end of the block; None
    without. By default at 127.0.0.1."""
    if named is None:
        yield None
        return
    kind, _, address = named.partition(":")
    host, _, port = address.rpartition(":")
    if kind != "udp" or not port.isdigit():
        raise ConfigurationError(f"--tracker is {named!r}, expected udp:PORT or udp:HOST:PORT.")
    found = hardware.UdpSightings((host or "127.0.0.1", int(port)), obstacles)
    try:
        found.wait(10.0, running)
        if not running():
            raise KeyboardInterrupt
        yield found
    finally:
        found.close()


def posture_of(named: str, robot: Robot, shown: list[np.ndarray] | None) -> np.ndarray:
    """The joints [n] of `--start`: numbers with commas between, rad, or K of demonstration K of those `shown`.

    **Raises** `ConfigurationError` for what is neither.
    """
    if named.isdigit() and robot.num_joints > 1:
        if shown is None or int(named) >= len(shown):
            known = "the demonstrations are not at hand" if shown is None else f"there are 0 to {len(shown) - 1}"
            raise ConfigurationError(f"--start {named}: {known}. Give joint positions: --start=Q1,Q2,...")
        return np.asarray(shown[int(named)][0], float)
    try:
        q = np.array([float(part) for part in named.split(",")])
    except ValueError as error:
        raise ConfigurationError(
            f"--start {named}: {error}. Expected joint positions, rad: --start=Q1,Q2,..."
        ) from error
    if q.shape != (robot.num_joints,) or not np.isfinite(q).all():
        raise ConfigurationError(f"--start has {len(q)} positions, and {robot.name} has {robot.num_joints} joints.")
    outside = (q < np.asarray(robot.lower)) | (q > np.asarray(robot.upper))
    if outside.any():
        names = [name for name, out in zip(robot.joint_names, outside, strict=True) if out]
        raise ConfigurationError(f"--start: {', '.join(names)} would be outside of the ranges of {robot.name!r}.")
    return q


def check_model(arm: Any, robot: Robot, state: hardware.ArmState) -> str | None:
    """Whether the arm's kinematics are those of `robot`: None where a frame of that is where the arm has its flange, or
    why that could not be looked at.

    **Raises** `ConfigurationError` if no frame is, or the arm has another number of joints.
    """
    if arm.joints != robot.num_joints:
        raise ConfigurationError(f"{robot.name!r} has {robot.num_joints} joints, and {arm.name} has {arm.joints}.")
    T = arm.hand_pose()
    if T is None:
        return None
    if (np.abs(state.qd) > _MOVES).any():
        return "the arm moves"
    # An arm may say where its flange is told to be.
    several = [np.asarray(frame_poses(robot, q.astype(float), robot.frame_names), float) for q in (state.q, state.q_d)]
    places = [np.linalg.norm(poses[:, :3, 3] - T[:3, 3], axis=-1) for poses in several]
    poses, place = min(zip(several, places, strict=True), key=lambda pair: pair[1].min())
    k = int(np.argmin(place))
    if place[k] > _SAME:
        raise ConfigurationError(
            f"{arm.name} says that its flange is at {np.round(T[:3, 3], 3).tolist()}, and no frame of {robot.name!r} "
            f"is: {robot.frame_names[k]}, the nearest, is {1000 * place[k]:.0f} mm away. It is another arm's skill, or "
            "its base is not where the arm's is."
        )
    axis = poses[place <= _SAME][:, :3, 2] @ T[:3, 2]  # flanges are named with one turn about their axis or another
    return None if axis.max() > 1 - _SAME_TURN else f"no frame of {robot.name!r} at the arm's flange has its axis"


def narrower(arm: Any, robot: Robot) -> list[str]:
    """Joints that the arm turns less far than the policy's robot, how far both do, in words."""
    lower, upper = np.asarray(robot.lower, float), np.asarray(robot.upper, float)
    low, high = np.asarray(arm.limits.lower), np.asarray(arm.limits.upper)
    less = (low > lower + 0.01) | (high < upper - 0.01)
    ranges = zip(robot.joint_names, low, np.minimum(high, upper), lower, upper, less, strict=True)
    return [f"{name} {a:.2f} to {b:.2f} ({c:.2f} to {d:.2f})" for name, a, b, c, d, narrow in ranges if narrow]


def check_writable(folder: Path) -> None:
    """**Raises** `OSError` unless files can be written to `folder`, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass


def write_log(
    arrays: dict[str, np.ndarray], folder: Path, robot: Robot, tracked: str
) -> tuple[Path, Path | None, str | None]:
    """A motion in `folder`: its NPZ and its MCAP, and why there is none of the latter."""
    file = hardware.save_motion(arrays, folder, robot.name, robot.joint_names, tracked)
    bag = folder / "mcap" / file.stem
    try:
        return file, hardware.save_mcap(arrays, bag, robot.joint_names, tracked), None
    except Exception as error:  # rosbags has errors of its own kind; the NPZ is there
        return file, None, f"no MCAP was written: {error}"
