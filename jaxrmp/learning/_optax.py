"""Optax, which trains metrics and flows here and is needed for nothing else."""

from typing import Any

from .._errors import importing


def import_optax() -> Any:
    """The module. **Raises** `MissingDependencyError` if it is not installed."""
    with importing("optax", "learning"):
        import optax
    return optax
