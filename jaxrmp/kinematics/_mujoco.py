"""MuJoCo, which reads robot files here and is needed for nothing else."""

from typing import Any

from .._errors import importing


def import_mujoco() -> Any:
    """The module. **Raises** `MissingDependencyError` if it is not installed."""
    with importing("mujoco", "robots"):
        import mujoco
    return mujoco
