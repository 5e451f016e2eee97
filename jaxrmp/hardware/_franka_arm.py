"""A Franka Research 3 over its network interface (FCI), by its maker's pylibfranka."""

import contextlib
import os
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from .._errors import ArmError, ConfigurationError, UnknownNameError, importing
from ..simulation import ArmDynamics
from ._arm import ArmState, Interface, state_of
from ._limits import MotionLimits

JOINTS = 7
PERIOD = 0.001
FR3_LIMITS = MotionLimits(
    lower=np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]),
    upper=np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]),
    velocity=np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]),
    acceleration=np.full(JOINTS, 10.0),
    jerk=np.full(JOINTS, 5000.0),
    torque=np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]),
    torque_rate=np.full(JOINTS, 1000.0),
    braking=np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0]),
    offset=np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35]),
)
"""Of a Franka Research 3, as its maker publishes them in the robot's URDF and libfranka's rate limits; velocities fall
towards the ends of joints' ranges."""
_OF_TORQUE_RATE = 0.45  # an arm may count the change of two cycles as that of one, as a motion begins
_HOLDING = 0.8 * FR3_LIMITS.torque  # tried on simulators with motors' inertia
REALTIME = ("enforce", "ignore")
_COLLISION = ([20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0], [20.0, 20.0, 20.0, 25.0, 25.0, 25.0])  # N m; N and N m


class FrankaArm:
    """A Franka Research 3 at `host`, an address or a name: robot system 5.9 or newer, FCI switched on, brakes open.

    **Arguments**: `realtime`, "enforce" for the scheduling that a real arm needs (a PREEMPT_RT kernel and the right to
    use it), "ignore" for simulators; `collision`, torques of joints [7], N m, and forces at the hand [6], N and N m,
    above which the arm stops by itself.
    **Raises** `ArmError` for an arm that cannot be reached, `MissingDependencyError` without pylibfranka.
    """

    name, joints, period, limits = "Franka Research 3", JOINTS, PERIOD, FR3_LIMITS
    interfaces = ("velocity", "torque")

    def __init__(self, host: str, realtime: str = "enforce", collision: Any = _COLLISION):
        UnknownNameError.check("realtime", realtime, REALTIME)
        with importing("pylibfranka", "franka"):
            import pylibfranka
        torques, forces = ([float(v) for v in values] for values in collision)
        if len(torques) != JOINTS or len(forces) != 6:
            raise ConfigurationError(f"collision has {len(torques)} and {len(forces)} thresholds, expected 7 and 6.")
        self._franka, self._interface, self._moving = pylibfranka, "", False
        self._control: Any = None
        self._model: Any = None
        self._robot: Any = None
        kinds = {"enforce": pylibfranka.RealtimeConfig.kEnforce, "ignore": pylibfranka.RealtimeConfig.kIgnore}
        with _as_scheduled(), self._as_arm_errors(f"at {host}"):
            self._robot = pylibfranka.Robot(host, kinds[realtime])
            self._raw = self._robot.read_once()
            self._robot.set_collision_behavior(torques, torques, forces, forces)
        self._torque = np.zeros(JOINTS)

    def read(self) -> ArmState:
        """The state of the next cycle."""
        with self._as_arm_errors("while it was read"):
            if self._control is None:
                self._raw = self._robot.read_once()
            else:
                self._raw, _ = self._control.readOnce()
        arrived, raw = time.perf_counter(), self._raw
        return state_of(arrived, raw.time.to_sec(), raw.q, raw.dq, raw.q_d, raw.dq_d, raw.tau_ext_hat_filtered)

    def start(self, interface: Interface) -> None:
        """Begin a motion by `interface`."""
        mode = self._raw.robot_mode
        if mode != self._franka.RobotMode.Idle:
            hint = {
                "Reflex": "It has not recovered from an error: --recover does that.",
                "UserStopped": "Its stop is in.",
            }
            raise ArmError(f"{self.name} is not ready, but {mode.name}. {hint.get(mode.name, 'Close other programs.')}")
        with _as_scheduled(), self._as_arm_errors("as a motion was started"):
            if interface == "torque":
                self._model = self._model or self._robot.load_model()
                self._control = self._robot.start_torque_control()
            else:
                impedance = self._franka.ControllerMode.JointImpedance
                self._control = self._robot.start_joint_velocity_control(impedance)
        self._interface, self._torque, self._moving = interface, np.zeros(JOINTS), True

    def send(self, command: np.ndarray, last: bool = False) -> None:
        """The `command` [7]: velocities, rad/s, or torques besides gravity's, N m, whose change a cycle is kept within
        the arm's limit; `last` ends the motion."""
        if self._control is None:
            raise ArmError(f"{self.name}: no motion was started.")
        if self._interface == "torque":
            most = _OF_TORQUE_RATE * PERIOD * FR3_LIMITS.torque_rate
            change = np.clip(np.asarray(command, float) - self._torque, -most, most)
            self._torque = np.clip(self._torque + change, -FR3_LIMITS.torque, FR3_LIMITS.torque)
            told = self._franka.Torques(self._torque.tolist())
        else:
            told = self._franka.JointVelocities(command.tolist())
        told.motion_finished = last
        with self._as_arm_errors("in motion"):
            self._control.writeOnce(told)
        if last:
            self._control, self._moving = None, False

    def dynamics(self) -> ArmDynamics:
        """By the arm's own model."""
        if self._model is None:
            raise ArmError(f"{self.name}: its model is loaded as a motion by torques is started.")
        M = np.array(self._model.mass(self._raw)).reshape(JOINTS, JOINTS)
        return ArmDynamics(M, np.array(self._model.coriolis(self._raw)))

    def holding(self) -> np.ndarray:
        """70 N m s/rad for large joints, 10 for those of the wrist, whose motors' inertia the model does not have."""
        return _HOLDING

    def hand_pose(self) -> np.ndarray | None:
        """The flange in the base, by the arm's own kinematics."""
        T_base_ee, T_flange_ee = (np.array(T).reshape(4, 4).T for T in (self._raw.O_T_EE, self._raw.F_T_EE))
        return T_base_ee @ np.linalg.inv(T_flange_ee)

    def recover(self) -> None:
        """Let the arm leave the state that an error left it in. **Raises** `ArmError` if it cannot."""
        with self._as_arm_errors("as it recovered"):
            self._robot.automatic_error_recovery()

    @property
    def guided(self) -> bool:
        """Whether somebody guides it by hand at the last state."""
        return self._raw.robot_mode == self._franka.RobotMode.Guiding

    def stop(self) -> None:
        """End a motion at once."""
        moving, self._moving, self._control = self._moving, False, None
        if moving:
            with self._as_arm_errors("as it was stopped"):
                self._robot.stop()

    def close(self) -> None:
        """Hang up."""
        self._control = self._model = self._robot = None

    def _as_arm_errors(self, when: str) -> "_ArmErrors":
        return _ArmErrors(self, when)


@contextlib.contextmanager
def _as_scheduled() -> Iterator[None]:
    """Keeps how this thread is scheduled: pylibfranka puts it above all others as it connects, and children inherit it.
    `drive` asks for what it needs."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, *before)


class _ArmErrors:
    """Turns what pylibfranka raises into an `ArmError` in words; made once a cycle, so kept lean."""

    __slots__ = ("_arm", "_when")

    def __init__(self, arm: FrankaArm, when: str):
        self._arm, self._when = arm, when

    def __enter__(self) -> None: ...

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        franka = self._arm._franka
        if error is None or not isinstance(error, RuntimeError | ValueError | franka.FrankaException):
            return
        self._arm._control = None
        said = str(error).removeprefix("libfranka: ")
        hint = ""
        if isinstance(error, franka.RealtimeException):
            hint = ' Without a real-time kernel, as with a simulator: --realtime ignore (realtime="ignore").'
        elif isinstance(error, franka.NetworkException):
            hint = " Is its cable in, its address right, FCI switched on?"
        raise ArmError(f"{self._arm.name} {self._when}: {said}{hint}") from error
