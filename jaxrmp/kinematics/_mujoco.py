"""MuJoCo, which reads robot files here and is needed for nothing else."""

import os
from pathlib import Path
from typing import Any

from .._errors import RobotError, importing


def import_mujoco() -> Any:
    """The module. **Raises** `MissingDependencyError` if it is not installed."""
    with importing("mujoco", "robots"):
        import mujoco
    return mujoco


def read_spec(path: str | os.PathLike) -> Any:
    """The `mujoco.MjSpec` of an MJCF or URDF file. **Raises** `RobotError`, `MissingDependencyError`."""
    mujoco = import_mujoco()
    if not Path(path).is_file():
        raise RobotError(f"{path}: there is no such file. Give the path of an MJCF or URDF file.")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except (OSError, ValueError) as error:
        raise RobotError(f"{path} cannot be read as MJCF or URDF: {error}") from error
