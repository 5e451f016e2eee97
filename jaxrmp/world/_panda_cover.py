"""Spheres on the built-in Panda and which of its bodies may touch, as plain numbers, for which MuJoCo is not needed."""

import functools
import json
from typing import Any, NamedTuple

import numpy as np

from ..kinematics import PANDA_MODEL, Robot
from ._robot_spheres import RobotSpheres, spheres_from_model

PANDA_COVER = PANDA_MODEL.with_name("panda_cover.json")  # by `_make_panda_cover`
_MAX_ERROR = 0.015  # m, of its spheres on the whole robot


class Cover(NamedTuple):
    """`spheres` on a whole robot; finer ones on its `hand`, the last link and what it carries; and for each body the
    bodies that it may touch, as `ignored_by_model` has them."""

    spheres: RobotSpheres
    hand: RobotSpheres
    ignored: dict[str, tuple[str, ...]]


def cover_to_dict(cover: Cover) -> dict[str, Any]:
    """What JSON can hold of a `cover`, exactly."""
    parts = {"spheres": cover.spheres, "hand": cover.hand}
    content: dict[str, Any] = {
        name: {
            "frames": list(part.frames),
            "offsets": np.asarray(part.offsets).tolist(),
            "radii": np.asarray(part.radii).tolist(),
            "coverage_error": part.coverage_error,
        }
        for name, part in parts.items()
    }
    return content | {"ignored": {name: list(others) for name, others in cover.ignored.items()}}


@functools.cache
def panda_cover() -> Cover:
    """That of the built-in Panda, from the package's own file."""
    content = json.loads(PANDA_COVER.read_text(encoding="utf-8"))
    spheres, hand = (
        RobotSpheres(tuple(c["frames"]), np.array(c["offsets"]), np.array(c["radii"]), c["coverage_error"])
        for c in (content["spheres"], content["hand"])
    )
    return Cover(spheres, hand, {name: tuple(others) for name, others in content["ignored"].items()})


@functools.cache
def panda_spheres(max_error: float = _MAX_ERROR) -> RobotSpheres:
    """Spheres for the built-in Panda that stick out of its own geometry by `max_error`, m, at most: by default 37.

    Others than the default need MuJoCo.
    """
    return panda_cover().spheres if max_error == _MAX_ERROR else spheres_from_model(PANDA_MODEL, max_error)


def built_in_cover(robot: Robot) -> Cover | None:
    """The cover of a `robot` that was read from the built-in Panda's file, all of it; None for any other."""
    if robot.source != str(PANDA_MODEL.resolve()):
        return None
    cover = panda_cover()
    return cover if set(cover.spheres.frames) <= {body.name for body in robot.model.bodies} else None
