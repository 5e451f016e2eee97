"""A robot as a stick figure, for one whose geometry is not at hand."""

from typing import Any

import numpy as np

from .._errors import importing
from ..kinematics import Robot
from ._shapes import Shape

_THICKNESS, _COLOUR = 0.012, (0.55, 0.6, 0.66, 1.0)


def skeleton(robot: Robot) -> list[Shape]:
    """A ball at every body's origin and a rod to it from its parent's, with the index of the body that carries them."""
    with importing("trimesh", "viewer"):
        from trimesh import creation, util
    shapes = []
    for i in range(len(robot.model.bodies)):
        parts = [creation.icosphere(subdivisions=2, radius=1.6 * _THICKNESS)] if i else []
        for child in robot.model.bodies:
            if child.parent == i and np.linalg.norm(child.position) > 1e-6:
                ends = np.array([np.zeros(3), child.position])
                parts.append(creation.cylinder(radius=_THICKNESS, segment=ends, sections=16))
        if parts:
            solid: Any = util.concatenate(parts)
            shapes.append(Shape(i, np.asarray(solid.vertices), np.asarray(solid.faces), _COLOUR, False))
    return shapes
