"""Skills in physics whose policy knows of the object what a depth camera overhead sees, by the command line.

From the recordings where `JAXRMP_DATA` is set, else from the synthetic demonstrations; half an hour.
"""

import os
from typing import Any

from . import physics

_CAMERA = ["--camera", "depth"]

# Name, task, arguments of `jaxrmp run`, how many of the first trials are judged by another row.
_BARS: list[tuple[str, str, list[str], int]] = [
    ("drawer, demonstrated starts", "drawer_closing", ["--scene", "drawer", *_CAMERA], 0),
    ("door, demonstrated poses", "door_reaching", ["--scene", "door", *_CAMERA], 0),
    ("door at 50 poses", "door_reaching", ["--scene", "door", "--trials", "56", *_CAMERA], 6),
    ("door displaced meanwhile", "door_reaching", ["--scene", "door", "--trials", "50", "--displace", *_CAMERA], 0),
]


def rows() -> list[dict[str, Any]]:
    """One row a bar: as `physics`, and what the camera saw."""
    source = "recordings" if os.environ.get("JAXRMP_DATA") else "synthetic"
    return [physics.row(source, *bar) for bar in _BARS]
