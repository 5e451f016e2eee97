"""Poses and robots as named on the command line of what a camera sees."""

import tomllib
from pathlib import Path

import numpy as np

from .._errors import ConfigurationError, JaxrmpError
from .._task_map import check_rigid
from ..kinematics import PANDA_MODEL, Robot, load_robot
from ..kinematics._robot_file import pose_of_numbers
from ._output import tell

_BEYOND = 0.1  # rad or m, by which a joint may be beyond its limits before that is told


def pose_named(named: str, option: str, key: str = "T_world_camera") -> np.ndarray:
    """[4, 4] of `x,y,z` or `x,y,z,roll,pitch,yaw`, m and rad; or of a file: NPY, a text of 4 x 4 numbers, or the `key`
    of a TOML or NPZ. **Raises** `ConfigurationError`, naming the `option`."""
    path = Path(named)
    try:
        if path.is_file():
            if path.suffix == ".toml":
                T = np.array(tomllib.loads(path.read_text(encoding="utf-8"))[key], float)
            elif path.suffix in (".npy", ".npz"):
                content = np.load(path, allow_pickle=False)
                T = content[key] if path.suffix == ".npz" else content
            else:
                T = np.loadtxt(path)
        else:
            return pose_of_numbers([float(part) for part in named.split(",")], option)
        if np.shape(T) != (4, 4):
            raise ConfigurationError(f"{option} {named}: its array has shape {np.shape(T)}, expected (4, 4).")
        return check_rigid(np.asarray(T, float), option)
    except KeyError as error:
        raise ConfigurationError(f"{option} {named}: the file has no {error}.") from error
    except (ValueError, TypeError, OSError, tomllib.TOMLDecodeError) as error:
        said = str(error) if isinstance(error, JaxrmpError) else f"{option} {named}: {error}"
        raise ConfigurationError(
            f"{said} Expected x,y,z,roll,pitch,yaw, m and rad, or a file of a 4 x 4 pose: .npy, .txt, .toml, .npz."
        ) from error


def robot_named(named: str) -> Robot:
    """The robot with its geometry: `panda`, the built-in one, or that of a file."""
    return load_robot(PANDA_MODEL, fixed={"*finger*": 0.04}) if named == "panda" else load_robot(named)


def check_joints(q: np.ndarray | None, robot: Robot, path: Path) -> np.ndarray:
    """The joints `q` [T, n] of the frames at `path`. **Raises** `ConfigurationError` unless they are the robot's."""
    if q is None:
        raise ConfigurationError(f"{path} has no q: record the joints of {robot.name!r} with each image.")
    if q.shape[1] != robot.num_joints:
        raise ConfigurationError(
            f"{path} has {q.shape[1]} joints an image, and {robot.name!r} has {robot.num_joints}: "
            f"{', '.join(robot.joint_names)}. A robot file (TOML) can lock joints: docs/guides/new_robot.md."
        )
    lower, upper = np.asarray(robot.lower), np.asarray(robot.upper)
    beyond = np.flatnonzero(((q < lower - _BEYOND) | (q > upper + _BEYOND)).any(0))
    if len(beyond):
        j = int(beyond[0])
        tell(
            f"{path}: {robot.joint_names[j]} goes from {q[:, j].min():.4g} to {q[:, j].max():.4g}, and the robot's "
            f"from {lower[j]:.4g} to {upper[j]:.4g}: joints are in rad, or m, in the order of the robot's file."
        )
    return q
