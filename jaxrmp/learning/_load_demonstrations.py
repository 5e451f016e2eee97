"""Demonstrations from the files that people have: what they are is known by their content."""

import os
import warnings
from pathlib import Path

from .._errors import DemonstrationError, FileWarning
from ..kinematics import Robot
from ._demonstration_files import NAME, read_folder
from ._demonstrations import DemonstrationSet
from ._hdf5_demonstrations import MAGIC, read_hdf5
from ._lerobot import INFO, read_lerobot
from ._on_robot import on_robot
from ._pose_files import is_poses, load_poses
from ._pose_settings import PoseSettings, example
from ._recording import RecordingSettings
from ._ros_bags import bags_at, read_bags

_KNOWN = "a folder of demo_0.npz or demo_0.csv, a LeRobotDataset, ROS bags, an HDF5 file of robomimic or robosuite"


def load_demonstrations(
    path: str | os.PathLike,
    recording: RecordingSettings | None = None,
    robot: Robot | None = None,
    base: str = "world",
    tracked: str = "",
    poses: PoseSettings | None = None,
) -> DemonstrationSet:
    """Read the demonstrations at `path`, a file or a folder, in the order of their numbers.

    What they are is known by the content:

    - `demo_K.npz` files with a `meta.json` (`robot`, `joint_names`; optional `source`, `num_demos`, `objects`,
      `units`): `time` [T], s; `joint_positions` [T, n], rad or m; optional `pose_world_base` and `pose_world_OBJECT`,
      [T, 4, 4] or [4, 4];
    - `demo_K.csv` files, a header and one line per sample: `time`, then the joints by name; optional
      `OBJECT_x, _y, _z, _qw, _qx, _qy, _qz`, the object's pose in the base frame; `meta.json` is optional with them;
    - a LeRobotDataset of version 2 or 3, which does not say its units;
    - bags of ROS 1 and 2, each a demonstration: joint states, and the transforms that lead from `base` to `tracked`;
    - an HDF5 file of robomimic or robosuite, the body `tracked` from its MuJoCo states;
    - poses of a hand without joints, as `load_poses` reads them and `on_robot` follows them with the `robot`.

    **Arguments**: `recording`, what the files do not say; `robot`, by whose joints their groups are told apart, and
    whose order holds for columns without names; `base`, the frame of objects' poses; `tracked`, the object whose pose
    to read where a file has many; `poses`, how the robot follows poses of a hand.
    **Returns** a `DemonstrationSet`; objects' poses are in the robot's base frame, `T_base_object = inv(T_world_base)
    T_world_object`, or as they are where no base pose is given. A `FileWarning` tells what was mended or left out.
    **Raises** `DemonstrationError`, naming the file, if something is missing, unreadable, not said or does not fit
    together; `RigidTransformError` if a pose is not a rigid transform; `UnknownNameError` for a group or frame that is
    not there; `MissingDependencyError` without the package that reads a format, which `jaxrmp[formats]` brings.
    """
    path, recording, poses = Path(path), recording or RecordingSettings(), poses or PoseSettings()
    told: list[str] = []
    found = _read(path, recording, robot, base, tracked, poses, told)
    of_joints = not is_poses(path)
    if recording.quaternion and of_joints:
        told.append("recording.quaternion (--quaternion) is of poses of a hand: here it says nothing.")
    if poses.start and of_joints:
        told.append("the section [poses] is of poses of a hand: here it says nothing.")
    if told:
        warnings.warn(f"{path}: " + " ".join(dict.fromkeys(told)), FileWarning, stacklevel=2)
    return found


def _read(
    path: Path,
    recording: RecordingSettings,
    robot: Robot | None,
    base: str,
    tracked: str,
    poses: PoseSettings,
    told: list[str],
) -> DemonstrationSet:
    inside = list(path.iterdir()) if path.is_dir() else []
    numbered = sorted(file.name for file in inside if NAME.fullmatch(file.name))
    if (path / INFO).is_file():
        _one_of(path, str(INFO), numbered)
        return read_lerobot(path, recording, robot, told)
    hdf5 = [file for file in inside or [path] if _is_hdf5(file)]
    bags = bags_at(path) if path.exists() else []
    if numbered:
        if others := sorted(file.name for file in {*hdf5, *bags} - {path}):
            told.append(f"{others} are not read, since there are {numbered[0]} and the like.")
    elif len(hdf5) == 1:
        _one_of(path, hdf5[0].name, [bag.name for bag in bags])
        return read_hdf5(hdf5[0], recording, robot, tracked, told)
    elif bags:
        return read_bags(path, recording, robot, base, tracked, told)
    if is_poses(path):
        return _followed(path, recording, robot, base, poses)
    if path.is_file():
        raise DemonstrationError(f"{path} is a file, and of no kind that is known. Give {_KNOWN}.")
    return read_folder(path, recording, told)


def _followed(
    path: Path, recording: RecordingSettings, robot: Robot | None, base: str, poses: PoseSettings
) -> DemonstrationSet:
    """The poses at `path` as `robot` follows them. **Raises** `DemonstrationError`, for all that is missing at once."""
    missing = ""
    if robot is None or not poses.start:
        missing = (
            f"{path} holds poses of a hand and no joints. Say with which robot and how they are followed: learn with a "
            f"configuration that has a section such as\n\n{example(robot)}\n\nor, in Python, give `robot` and "
            "`poses`; learning.load_poses reads them as they are."
        )
    elif not poses.frame:
        missing = f"{path} holds poses of a hand: say of which frame of {robot.name!r}, poses.frame."
    try:
        read = load_poses(path, recording)
    except DemonstrationError as error:
        raise DemonstrationError(f"{missing} {error}".strip()) from error
    if missing or robot is None:
        raise DemonstrationError(missing)
    return on_robot(read, robot, poses.frame, poses.posture(robot), base, poses.place)


def _one_of(path: Path, name: str, others: list[str]) -> None:
    if others:
        raise DemonstrationError(f"{path} holds both {name} and {others[0]}: keep one of the two kinds.")


def _is_hdf5(file: Path) -> bool:
    try:
        with open(file, "rb") as content:
            return content.read(len(MAGIC)) == MAGIC
    except OSError:
        return False
