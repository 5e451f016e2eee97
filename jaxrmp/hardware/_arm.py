"""What a loop needs of an arm, whatever it is: read its state, tell it how to move, stop it."""

from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from ..simulation import ArmDynamics
from ._limits import MotionLimits

Interface = Literal["velocity", "torque"]
INTERFACES = ("velocity", "torque")


class ArmState(NamedTuple):
    """An arm of n joints at one of its cycles.

    `time`, s, by the arm's own clock; `q`, `qd` [n], measured, rad and rad/s; `q_d`, `qd_d` [n], where it takes
    itself to have been told to be, and how fast; `external` [n], its own estimate of torques from outside, N m, NaN
    where it has none; `arrived`, when it was there, by `time.perf_counter`.
    """

    time: float
    q: np.ndarray
    qd: np.ndarray
    q_d: np.ndarray
    qd_d: np.ndarray
    external: np.ndarray
    arrived: float


class Arm(Protocol):
    """An arm that is driven cycle by cycle; `MujocoArm` and `FrankaArm` are two.

    `name`; `joints`, how many; `limits`; `period`, s from cycle to cycle; `interfaces`, those of `INTERFACES` that it
    has. Whatever goes wrong on the arm's side is an `ArmError`, after which it is not moving on its own.
    """

    name: str
    joints: int
    limits: MotionLimits
    period: float
    interfaces: tuple[str, ...]

    def read(self) -> ArmState:
        """Wait for the next cycle and give its state."""
        ...

    def start(self, interface: Interface) -> None:
        """Begin a motion by `interface`: from now on each `read` is answered by a `send`."""
        ...

    def send(self, command: np.ndarray, last: bool = False) -> None:
        """The `command` [n] of this cycle: velocities, rad/s, or torques besides gravity's, N m; `last` ends the
        motion."""
        ...

    def dynamics(self) -> ArmDynamics:
        """Mass matrix and Coriolis torques at the last state, without gravity, for the interface "torque"."""
        ...

    def holding(self) -> np.ndarray:
        """How much each joint may be damped about its reference besides, N m s/rad [n], by the interface "torque": less
        than what would shake it, for its inertia, motor included, and the arm's period."""
        ...

    def hand_pose(self) -> np.ndarray | None:
        """Where the arm takes its flange to be at the last state, [4, 4] in its base; None if it does not say."""
        ...

    def stop(self) -> None:
        """End a motion at once, as the arm does it; nothing if it is not in one."""
        ...

    def close(self) -> None:
        """Let go of the arm."""
        ...


def state_of(arrived: float, time: float, q: Any, qd: Any, q_d: Any, qd_d: Any, external: Any) -> ArmState:
    """An `ArmState` of `arrived`, `time`, `q`, `qd`, `q_d`, `qd_d` and `external`, of anything that NumPy takes for
    numbers."""
    q, qd, q_d, qd_d, external = (np.array(column, np.float32) for column in (q, qd, q_d, qd_d, external))
    return ArmState(float(time), q, qd, q_d, qd_d, external, arrived)
