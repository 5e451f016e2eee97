"""Spheres on a robot, and which of them may meet, from the file that the robot was read from."""

from typing import Any

import numpy as np

from .._errors import ConfigurationError
from ..kinematics import Robot
from ._robot_spheres import RobotSpheres, cover_model, geometry_of_model
from ._self_pairs import ignored_by_model, link_of, self_pairs

_FINENESS = (0.008, 0.015, 0.03, 0.06)  # m, how far spheres may stick out; the first is for hands
_ENOUGH = 100  # spheres: the first fineness that does with as many is taken, else the last


def own_spheres(robot: Robot, hand: str | None = None) -> RobotSpheres:
    """Spheres that cover a `robot`, from the geometry of its own file: for the built-in Panda, `panda_spheres()`.

    They stick out of it by 1.5 cm at most, or by 3 or 6 where else there would be more than 100. The link of the frame
    `hand` and what it carries, which pass close to things, are covered to 8 mm if possible.
    **Raises** `RobotError` if the robot was read from no file or its geometry cannot be read (meshes that are not
    there), `ConfigurationError` if it has none, `UnknownNameError` for a frame that is not there.
    """
    model = geometry_of_model(robot)
    whole = _finest(model, robot.source, _FINENESS[1:], None)
    link = None if hand is None else link_of(robot, hand)
    bodies = {name: robot.model.frames[robot.frame_index(name)].body for name in whole.frames}
    carried = tuple(name for name, body in bodies.items() if link in robot.model.path(body))
    if not carried:
        return whole
    fine, rest = _finest(model, robot.source, _FINENESS, carried), whole.without(*carried)
    return RobotSpheres(
        (*fine.frames, *rest.frames),
        np.concatenate([fine.offsets, rest.offsets]),
        np.concatenate([fine.radii, rest.radii]),
        max(fine.coverage_error, rest.coverage_error),
    )


def own_self_pairs(robot: Robot, spheres: RobotSpheres) -> tuple[tuple[int, int], ...]:
    """The pairs of `spheres` that must not meet, by `self_pairs` and what the own file of `robot` excludes."""
    return self_pairs(robot, spheres.frames, ignored_by_model(robot) if robot.source else None)


def _finest(model: Any, source: str, fineness: tuple[float, ...], frames: tuple[str, ...] | None) -> RobotSpheres:
    for error in fineness[:-1]:
        try:
            found = cover_model(model, error, frames, source)
        except ConfigurationError:  # too many, or no geometry, which the last says too
            continue
        if found.size <= _ENOUGH:
            return found
    return cover_model(model, fineness[-1], frames, source)
