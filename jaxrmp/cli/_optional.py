"""Packages that a command can do without, and those that it cannot: these are asked for before the work begins."""

from importlib import import_module

from .._errors import MissingDependencyError, importing
from ._output import tell

# What is imported of each package, by the extra that brings them.
_MODULES = {
    "learning": {"flax": "flax.linen", "optax": "optax", "cvxpy": "cvxpy"},
    "plots": {"matplotlib": "matplotlib.figure"},
    "simulation": {"imageio-ffmpeg": "imageio_ffmpeg"},
    "export": {"flatbuffers": "flatbuffers"},
    "viewer": {"viser": "viser", "trimesh": "trimesh"},
}


def require(*extras: str) -> None:
    """**Raises** `MissingDependencyError` for a package of the extras that is not installed."""
    for extra in extras:
        for package, module in _MODULES[extra].items():
            with importing(package, extra):
                import_module(module)


def can_draw(what: str = "pictures") -> bool:
    """Whether figures can be drawn; where they cannot, a line says what they need."""
    try:
        require("plots")
    except MissingDependencyError as error:
        tell(f"without {what}, for {error.package} is not installed: {error.remedy}")
        return False
    return True
