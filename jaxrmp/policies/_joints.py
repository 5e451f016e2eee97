"""What joints need, whatever the arm does: limits, a posture, damping."""

from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from .._errors import ConfigurationError, ShapeError
from .._tree import Leaf, Node, Sum, on_coordinates
from ..kinematics import Robot
from ..leaves import Damping, JointLimit, JointVelocityLimit, Posture

_ROUNDING = 1e-5  # rad or m, by which a posture in single precision may be beyond a limit
NOTHING = Sum(())
"""The sum of no policies: what a piece is where there is nothing to do. Added to a node, it leaves that as it is."""


def joint_limits(robot: Robot, leaf: Leaf | None = None, **gains: Any) -> Node:
    """Keeps the joints that have limits within them; `NOTHING` for a `robot` without. The limits must be numbers.

    **Arguments**: `leaf`, on those joints alone, by default a `JointLimit` with `weight=0.05, damping_rate=5.0,
    barrier=0.003, reach=0.2`, as the scenes benchmark has it (docs/world.md); `gains`, parameters in place of the
    leaf's. **Raises** as the leaf, `RobotError` by name for a joint whose range is empty, and `TypeError` for a gain
    that the leaf does not have.
    """
    robot.check_ranges()
    limits = np.asarray(robot.lower), np.asarray(robot.upper)
    lower, upper = (limit[list(robot.limited)] for limit in limits)
    leaf = leaf or JointLimit(lower, upper, weight=0.05, damping_rate=5.0, barrier=0.003, reach=0.2)
    return on_coordinates(robot.limited, robot.num_joints, replace(leaf, **gains))


def velocity_limits(robot: Robot, leaf: Leaf | None = None, **gains: Any) -> Node:
    """Keeps the joints that have velocity limits below them; `NOTHING` without any. Arguments as `joint_limits`.

    By default a `JointVelocityLimit` with `onset=0.6`, the share of a limit from which on it is felt.
    """
    limit = np.asarray(robot.velocity_limit)
    rows = np.flatnonzero(np.isfinite(limit)).tolist()
    leaf = replace(leaf or JointVelocityLimit(limit[rows], onset=0.6), **gains)
    return on_coordinates(tuple(rows), robot.num_joints, leaf)


def posture(robot: Robot, rest: Any = None, **gains: Any) -> Node:
    """Draws a `robot` to `rest` [n], rad or m, by default its `middle`, weakly: it decides where no task does.

    **Arguments**: `gains` of `Posture`, by default `weight=0.02`, `stiffness=0.5`, 1/s^2, and `damping_rate=3.0`, 1/s,
    for a hand that follows a goal dragged on a page. **Raises** as `joint_limits`, `ShapeError` for a `rest` of another
    shape, `ConfigurationError`, by joint, for one that is not finite or beyond the joints' limits.
    """
    rest = robot.middle if rest is None else rest if isinstance(rest, jax.Array) else np.asarray(rest, float)
    if rest.shape != (robot.num_joints,):
        raise ShapeError(f"rest has shape {rest.shape}, expected ({robot.num_joints},): a position of each joint.")
    if not isinstance(rest, Tracer):
        _check_within(robot, np.asarray(rest, float))
    return Posture(rest, **{"weight": 0.02, "stiffness": 0.5, "damping_rate": 3.0, **gains})


def damping(**gains: Any) -> Node:
    """Slows all joints down, and gives motion that no task takes a metric.

    **Arguments**: `gains` of `Damping`, by default `weight=0.02`, little next to tasks of weight 0.2 to 5, and
    `damping_rate=1.0`, 1/s. **Raises** as `joint_limits`.
    """
    return Damping(**{"weight": 0.02, "damping_rate": 1.0, "name": "joint_damping", **gains})


def _check_within(robot: Robot, rest: np.ndarray) -> None:
    lower, upper = np.asarray(robot.lower), np.asarray(robot.upper)
    bad = np.flatnonzero(~(np.isfinite(rest) & (rest >= lower - _ROUNDING) & (rest <= upper + _ROUNDING)))
    if bad.size:
        wrong = ", ".join(f"{robot.joint_names[i]} {rest[i]:g} (from {lower[i]:g} to {upper[i]:g})" for i in bad)
        raise ConfigurationError(
            f"rest of {robot.name!r} is not finite, or beyond the limits, at {wrong}: expected a posture that the "
            "joints can have, such as robot.middle."
        )
