"""What an arm may be told: its limits of motion, and commands that keep them."""

from dataclasses import fields as dataclass_fields
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import RobotError
from .._pytree import pytree
from ..kinematics import Robot

ACCELERATION, JERK = 10.0, 5000.0
"""Of a joint whose limits nobody states, rad/s^2 (m/s^2) and rad/s^3 (m/s^3)."""
_OFFSET = 0.15  # rad/s (m/s): such an arm ends its motion half a hundredth of a rad before the end of a range

# Shares of the limits that commands use: what is left is for the arm's own arithmetic.
_OF_VELOCITY, _OF_ACCELERATION, _OF_JERK, _OF_BRAKING = 0.95, 0.9, 0.3, 0.5
_RATE = 100.0  # 1/s, at which a velocity comes to its bound
_STOP = 20.0  # 1/s, at which the last of a velocity dies as an arm brakes


@pytree
class MotionLimits:
    """The limits of an arm of n joints, each field [n].

    `lower`, `upper`, rad or m; `velocity`, `acceleration`, `jerk`, per second, second squared and cubed; `torque`, N m
    or N, and `torque_rate`, per second. Towards the end of a range an arm may be slower: by at most
    `sqrt(2 braking distance) - offset`, with `braking`, rad/s^2, and `offset`, rad/s. Infinite for none.
    """

    lower: Any
    upper: Any
    velocity: Any
    acceleration: Any
    jerk: Any
    torque: Any
    torque_rate: Any
    braking: Any
    offset: Any

    @classmethod
    def of_robot(cls, robot: Robot, torque: Any = np.inf, torque_rate: Any = np.inf) -> "MotionLimits":
        """The limits in the file of `robot`, with `ACCELERATION` and `JERK`, which such files do not have.

        **Arguments**: `torque`, `torque_rate` [n] or numbers.
        """
        n = robot.num_joints
        values = (ACCELERATION, JERK, torque, torque_rate, 0.5 * ACCELERATION, _OFFSET)
        given = [np.broadcast_to(np.asarray(v, float), n) for v in values]
        return cls(*(np.asarray(v, float) for v in (robot.lower, robot.upper, robot.velocity_limit)), *given)

    def velocity_range(self, q: Any) -> tuple[Any, Any]:
        """The lowest and highest velocity [n] that joints may have at `q` [n]."""

        return -self._towards(q - self.lower), self._towards(self.upper - q)

    def with_margin(self) -> "MotionLimits":
        """What commands keep to: somewhat less than the arm allows, so that its own arithmetic does not matter."""
        velocity, jerk = _OF_VELOCITY * self.velocity, _OF_JERK * self.jerk
        # An acceleration that jerk can take back in the time in which a velocity comes to its bound.
        acceleration = jnp.minimum(_OF_ACCELERATION * self.acceleration, jerk / _RATE)
        braking = _OF_BRAKING * jnp.minimum(self.braking, acceleration)
        return replace(self, velocity=velocity, acceleration=acceleration, jerk=jerk, braking=braking)

    def _towards(self, distance: Any) -> Any:
        inside = jnp.where(distance > 0, 2.0 * self.braking * jnp.where(distance > 0, distance, 1.0), 0.0)
        return jnp.clip(jnp.sqrt(inside) - self.offset, 0.0, self.velocity)


class Limited(NamedTuple):
    """A command within limits: velocities `qd` and accelerations `qdd` [n], and `cut` [n], what was asked for less
    what was given, rad/s^2."""

    qd: Any
    qdd: Any
    cut: Any


def limited(limits: MotionLimits, q: Any, qd: Any, qdd: Any, wanted: Any, dt: Any) -> Limited:
    """The next command of an arm whose last one had velocity `qd` and acceleration `qdd`, towards acceleration
    `wanted`, with velocity, acceleration and jerk in `limits`, all [n].

    Accelerations and jerks that are too large are scaled as a whole, so that the arm keeps its way; the bounds of
    velocities, which fall towards the ends of joints' ranges, hold for each joint on its own. Standing still is always
    allowed.

    **Arguments**: `q` [n], where the arm is; `dt`, s from command to command.
    """
    kept = limits.with_margin()
    low, high = kept.velocity_range(q)
    most, change = kept.acceleration, kept.jerk * dt
    new = qdd + _scaled(_scaled(wanted, most) - qdd, change)
    new = jnp.clip(new, jnp.maximum(_RATE * (low - qd), -most), jnp.minimum(_RATE * (high - qd), most))
    new = qdd + jnp.clip(new - qdd, -change, change)
    return Limited(qd + dt * new, new, wanted - new)


def brake(limits: MotionLimits, q: Any, qd: Any, qdd: Any, dt: Any) -> Limited:
    """The next command of an arm that is to stop: straight on, ever slower. Arguments as `limited`."""
    return limited(limits, q, qd, qdd, -_STOP * qd, dt)


def _scaled(value: jax.Array, most: Any) -> jax.Array:
    """`value` [n], made smaller as a whole until no entry is larger than that of `most` [n]."""
    share = jnp.max(jnp.abs(value) / most)
    return value / jnp.maximum(share, 1.0)


def check_limits(limits: MotionLimits, joints: int) -> MotionLimits:
    """`limits` as arrays [n]. **Raises** `RobotError` unless they are those of so many `joints`, and not empty."""
    given = {field.name: getattr(limits, field.name) for field in dataclass_fields(limits)}
    fields = {name: np.asarray(value, float) for name, value in given.items()}
    for name, value in fields.items():
        if value.shape != (joints,) or np.isnan(value).any():
            raise RobotError(f"limits.{name} is {value}, expected a number for each of {joints} joints.")
    for name in ("velocity", "acceleration", "jerk", "braking"):
        if not (fields[name] > 0).all():
            raise RobotError(f"limits.{name} is {fields[name]}, expected positive numbers.")
    if not (np.isfinite(fields["offset"]) & (fields["offset"] >= 0)).all():
        raise RobotError(f"limits.offset is {fields['offset']}, expected numbers that are not negative.")
    if not (fields["lower"] < fields["upper"]).all():
        raise RobotError(f"limits.lower {fields['lower']} is not below limits.upper {fields['upper']}.")
    return MotionLimits(**fields)
