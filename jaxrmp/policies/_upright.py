"""A hand that is kept upright, whatever else it does."""

from dataclasses import replace
from typing import Any

import numpy as np

from .._tree import Batched, Node, pullback
from ..kinematics import FrameAxes, Robot
from ..leaves import DirectionAttractor

UPRIGHT = DirectionAttractor(np.array([0.0, 0.0, 1.0]), 5.0, stiffness=100.0, damping_rate=20.0, name="upright")
"""Holds a direction within about a degree against a hand that is turned to its goal."""


def upright(robot: Robot, frame: str, axis: int = 2, leaf: DirectionAttractor = UPRIGHT, **gains: Any) -> Node:
    """Keeps an axis of a `frame` of the `robot` upright, so that nothing is spilled: a potential, certified.

    To be added to a policy, `replace(policy, always=policy.always + upright(robot, "hand", axis=0))`; where its goal is
    upright too, they agree there.

    **Arguments**: `axis` of the frame, 0 for x, 1 for y, 2 for z; `leaf`, on its direction [3] in the world, and
    `gains`, parameters in place of the leaf's, such as `direction=(0, 0, -1)` for an axis that is to point down.
    **Raises** `UnknownNameError` for a frame that is not there, `ShapeError` for another axis.
    """
    return pullback(FrameAxes(robot, frame, (axis,)), Batched(replace(leaf, **gains), shared=True))
