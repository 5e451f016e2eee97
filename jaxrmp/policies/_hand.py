"""A hand at a pose: where a frame is to be, and how it is to be turned."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import matmul
from .._pytree import pytree, static
from .._tree import Node, pullback
from ..kinematics import FrameRotation, Position, Robot
from ..leaves import Attractor, OrientationAttractor
from ._joints import NOTHING

HAND_POSITION = Attractor(np.zeros(3), 5.0, 5.0, gain=10.0, sharpness=15.0, damping_rate=24.0, name="hand_position")
"""Brings a frame to a point at 0.42 m/s (gain over damping rate), for a goal that is dragged on a page: with the others
it is damped inverse kinematics. The goal that it has counts for nothing."""

HAND_ORIENTATION = OrientationAttractor(np.eye(3), 0.2, stiffness=50.0, damping_rate=14.0, name="hand_orientation")
"""Turns a frame, critically damped, within about half a second. The goal that it has counts for nothing."""


def hand_at(
    robot: Robot,
    frame: str,
    T_world_goal: jax.Array,
    position: Attractor | None = HAND_POSITION,
    orientation: OrientationAttractor | None = HAND_ORIENTATION,
) -> Node:
    """Brings a `frame` of the `robot` to a pose `T_world_goal` [4, 4], m, and holds it there against what pushes it.

    **Arguments**: `position` and `orientation`, the leaves for the two, their goals set from the pose; None leaves the
    position, or the turn, free.
    **Raises** `UnknownNameError` for a frame that is not there, `RigidTransformError` for a rotation that is none.
    """
    T, node = jnp.asarray(T_world_goal), NOTHING
    if position is not None:
        node = node + pullback(Position(robot, frame), replace(position, goal=T[:3, 3]))
    if orientation is not None:
        node = node + pullback(FrameRotation(robot, frame), replace(orientation, R_world_goal=T[:3, :3]))
    return node


@pytree
class HandGoal:
    """The task of an `ArmPolicy` to have a frame at `T_target_frame` [4, 4]; the rest as `hand_at` has it."""

    T_target_frame: Any
    frame: str = static()
    position: Attractor | None = HAND_POSITION
    orientation: OrientationAttractor | None = HAND_ORIENTATION

    def tree(self, robot: Robot, T_world_target: jax.Array) -> Node:
        """The policy of a `robot` with the target at `T_world_target` [4, 4]."""
        T = matmul(jnp.asarray(T_world_target), self.T_target_frame)
        return hand_at(robot, self.frame, T, self.position, self.orientation)

    def hand(self, T_world_target: jax.Array) -> tuple[str, Any, jax.Array] | None:
        """What goes where with the target at `T_world_target` [4, 4]: frame, point in it [3], m, and that point's goal
        [3] in the world, m; None if the position is free."""
        if self.position is None:
            return None
        return self.frame, np.zeros(3, np.float32), matmul(jnp.asarray(T_world_target), self.T_target_frame)[:3, 3]
