"""Covers that were found before, on disk by what they were found from."""

import hashlib
import logging
import os
from pathlib import Path
from typing import Any

import numpy as np

from .._files import atomic_write, read_npz

logger = logging.getLogger(__name__)

_GEOMETRY = (
    *("geom_type", "geom_size", "geom_pos", "geom_quat", "geom_bodyid", "geom_contype", "geom_conaffinity"),
    *("geom_dataid", "mesh_vertadr", "mesh_vertnum", "mesh_vert", "body_weldid", "body_parentid"),
    *("body_pos", "body_quat", "names"),
)


def cover_file(m: Any, *settings: Any) -> Path:
    """Where the cover of a `mujoco.MjModel` by these settings is kept: in the folder that the environment variable
    `JAXRMP_CACHE` names, by default `~/.cache/jaxrmp`, by geometry, settings and the code that finds covers."""
    told = hashlib.sha256(repr(settings).encode())
    for name in _GEOMETRY:
        value = getattr(m, name)
        told.update(value if isinstance(value, bytes) else np.ascontiguousarray(value).tobytes())
    for name in ("_cover.py", "_polytopes.py", "_robot_spheres.py"):
        told.update(Path(__file__).with_name(name).read_bytes())
    folder = Path(os.environ.get("JAXRMP_CACHE") or "~/.cache/jaxrmp").expanduser()
    return folder / "spheres" / f"{told.hexdigest()[:32]}.npz"


def read_cover(file: Path) -> dict[str, np.ndarray] | None:
    """What `write_cover` wrote, None if there is nothing that can be read."""
    try:
        return read_npz(file)
    except (OSError, ValueError):
        return None


def write_cover(file: Path, **arrays: Any) -> None:
    """Keep arrays, at once or not at all; where nothing can be written, covers are found anew each time."""
    try:
        with atomic_write(file) as made:
            np.savez(made, **arrays)
    except OSError as error:
        logger.info("the cover is not kept in %s: %s", file, error)
