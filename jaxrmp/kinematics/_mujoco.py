"""MuJoCo, which reads robot files here and is needed for nothing else."""

from typing import Any

from .._errors import MissingDependencyError


def import_mujoco() -> Any:
    """The module. **Raises** `MissingDependencyError` if it is not installed."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingDependencyError("mujoco", "robots") from error
    return mujoco
