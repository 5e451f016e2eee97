"""Whether a robot is clear of itself in demonstrated postures, by the spheres that whole-arm policies keep apart."""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._errors import FileWarning, JaxrmpError, NoGeometryError
from ..kinematics import Robot
from ..world import RobotSpheres, own_self_pairs, own_spheres, self_clearance
from ..world._own_spheres import mend_cover


class OwnCover(NamedTuple):
    """The `spheres` on a robot and the `pairs` of them that `policies.whole_arm_policy` keeps apart."""

    spheres: RobotSpheres
    pairs: tuple[tuple[int, int], ...]


class OwnClearance(NamedTuple):
    """How close a robot comes to itself in demonstrations: the least `distance` of its spheres, m, below 0 where they
    overlap, NaN where it is not known and `why` says so; between the spheres of two `frames`, in `demonstration` and
    `sample`."""

    distance: float
    frames: tuple[str, str] = ("", "")
    demonstration: int = 0
    sample: int = 0
    why: str = ""

    def __str__(self) -> str:
        if np.isnan(self.distance):
            return f"not known: {self.why}"
        if np.isinf(self.distance):
            return "no two links that could touch"
        state = "overlap by" if self.distance < 0 else "are apart by"
        return (
            f"spheres on {' and '.join(self.frames)} {state} {100 * abs(self.distance):.1f} cm in demonstration "
            f"{self.demonstration} at sample {self.sample}"
        )


def own_cover(robot: Robot) -> OwnCover:
    """What covers a `robot`, from its own file. **Raises** as `world.own_spheres`."""
    spheres = own_spheres(robot)
    return OwnCover(spheres, own_self_pairs(robot, spheres))


def clearance_of(robot: Robot, cover: OwnCover, ways: Sequence[np.ndarray]) -> OwnClearance:
    """The least distance of a `cover` along `ways`, joint positions [T, n], one array a demonstration."""
    found = self_clearance(robot, *cover, np.concatenate(ways))
    ends = np.cumsum([len(way) for way in ways])
    k = int(np.searchsorted(ends, found.posture, side="right"))
    return OwnClearance(found.distance, found.frames, k, found.posture - int(ends[k]) + len(ways[k]))


def own_clearance(robot: Robot, ways: Sequence[np.ndarray], of_poses: bool = False) -> OwnClearance:
    """How close a `robot` comes to itself along `ways`, joint positions [T, n] of each demonstration, rad or m.

    A `FileWarning` tells if spheres overlap, which whole-arm policies keep apart, and what to do about it; `of_poses`
    whether inverse kinematics chose the postures. Another tells if the robot's geometry cannot be had, as of meshes
    that are not there. Of a robot without any, the result alone says so.
    """
    try:
        cover = own_cover(robot)
    except NoGeometryError as error:
        return OwnClearance(np.nan, why=str(error))
    except JaxrmpError as error:
        warnings.warn(
            f"whether {robot.name!r} is clear of itself in the demonstrations is not known, and policies of the whole "
            f"arm (run, evaluate, view, export) will fail: {error}",
            FileWarning,
            stacklevel=3,
        )
        return OwnClearance(np.nan, why=str(error))
    found = clearance_of(robot, cover, ways)
    if found.distance < 0:
        mend = "Choose another start posture (poses.start)" if of_poses else "Demonstrate with the arm clear of itself"
        warnings.warn(
            f"{robot.name!r}: in the demonstrated postures {found}. A policy of the whole arm (run, evaluate, view, "
            "export) keeps them apart and may rest off the goal, which reproduce, of the skill alone, does not show. "
            f"{mend}. {mend_cover(robot, cover.spheres, [found.frames], cover.pairs)}",
            FileWarning,
            stacklevel=3,
        )
    return found
