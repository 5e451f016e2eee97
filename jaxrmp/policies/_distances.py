"""Keeping off: the robot's spheres from obstacles, and from each other."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from jax.core import Tracer

from .._tree import Leaf, Node, pullback
from ..kinematics import Robot
from ..leaves import CollisionAvoidance
from ..world import ObstacleDistances, RobotSpheres, SelfDistances, World, own_self_pairs, without_never_near
from ._joints import NOTHING

SELF_AVOIDANCE = CollisionAvoidance(0.1, 0.01, 2.0, 0.05, 0.1, 0.003, frequency=100.0, name="self_collision")
"""Felt within 5 cm, with a barrier that stops an arm of a metre; tuned in the scenes benchmark, at steps of 1 ms."""

AVOIDANCE = replace(SELF_AVOIDANCE, reach=0.06, name="collision_avoidance")
"""As `SELF_AVOIDANCE`, but felt within 6 cm."""


def avoidance(robot: Robot, spheres: RobotSpheres | None, world: World, leaf: Leaf = AVOIDANCE, **gains: Any) -> Node:
    """Keeps spheres on a `robot` off the obstacles of a `world`; `NOTHING` without spheres or slots.

    **Arguments**: `spheres`, such as `own_spheres(robot).moving(robot)`: those of a base would feel what it stands on;
    `leaf`, on the distances, m; `gains`, parameters in place of the leaf's.
    **Raises** `UnknownNameError` for spheres on frames that are not there, and as `joint_limits`.
    """
    if spheres is None or not spheres.size or not world.size:
        return NOTHING
    return pullback(ObstacleDistances(spheres.points(robot), world, spheres.radii), replace(leaf, **gains))


def self_avoidance(
    robot: Robot,
    spheres: RobotSpheres | None,
    pairs: Iterable[tuple[int, int]] | None = None,
    leaf: Leaf = SELF_AVOIDANCE,
    **gains: Any,
) -> Node:
    """Keeps `pairs` (i, j) of spheres on the robot off each other, by default those of `own_self_pairs(robot, spheres)`
    that ever come near, to twice the leaf's `reach` or 10 cm (`without_never_near`).

    `NOTHING` without pairs; the rest as `avoidance`.
    """
    if spheres is None:
        return NOTHING
    leaf = replace(leaf, **gains)
    if pairs is None:
        reach, pairs = getattr(leaf, "reach", 0.0), own_self_pairs(robot, spheres)
        if not isinstance(reach, Tracer):  # whose number is not known
            pairs = without_never_near(robot, spheres, pairs, max(0.1, 2 * float(np.max(reach))))
    pairs = tuple(pairs)
    return pullback(SelfDistances(spheres.points(robot), pairs, spheres.radii), leaf) if pairs else NOTHING
