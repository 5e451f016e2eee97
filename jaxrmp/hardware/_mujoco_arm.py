"""An arm in a scene of MuJoCo, driven through the same interface as one of steel."""

import time
from typing import Any

import numpy as np

from .._errors import ArmError
from ..scenes import Scene
from ..simulation import (
    ArmDynamics,
    PhysicalArm,
    Tracker,
    arm_dynamics,
    tracking_acceleration,
)
from ._arm import ArmState, Interface, state_of
from ._limits import MotionLimits
from ._sightings import Sighting

_STIFFNESS, _DAMPING = 400.0, 40.0  # 1/s^2, 1/s, of the arm's own loop
_OF_INERTIA, _OF_TORQUE = 0.2, 0.8  # of an inertia a period, and s/rad times a torque: how joints are held by torques
_MOST = 200  # cycles that it makes up for at once


class MujocoArm:
    """The arm of a `scene`, at `q` [n] at first; time passes as on the clock, or as it is asked, if not `real_time`.

    By velocities it has a loop of its own that follows them, within its torque limits. Cycles that nobody answers pass,
    as on an arm: it goes on with its last command. `data` is its `mujoco.MjData`.

    **Raises** `ConfigurationError` for a start in collision.
    """

    interfaces = ("velocity", "torque")

    def __init__(self, scene: Scene, q: Any, real_time: bool = True):
        self.name, self.joints = f"{scene.robot.name} in the scene {scene.name}", scene.robot.num_joints
        self._arm = PhysicalArm(scene, scene.data(np.asarray(q, float)))
        self.scene, self.data = scene, self._arm.data
        self.period = float(scene.model.opt.timestep)
        self.limits = MotionLimits.of_robot(scene.robot, scene.torque_limit)
        self._real_time, self._due = real_time, None
        self._interface: str = ""
        self._q_d, self._qd_d = np.array(q, float), np.zeros(self.joints)
        self._torque = np.zeros(self.joints)
        self._arm.sense()

    def read(self) -> ArmState:
        """The state after the next millisecond, or after as many as have passed."""
        for _ in range(self._passed()):
            self._pass()
        if not (np.isfinite(self.data.qpos).all() and np.isfinite(self.data.qvel).all()):
            raise ArmError(f"{self.name}: its state is not finite.")
        q, qd = self._arm.state()
        return state_of(time.perf_counter(), self.data.time, q, qd, self._q_d, self._qd_d, np.full(self.joints, np.nan))

    def start(self, interface: Interface) -> None:
        """From now on, by `interface`."""
        self._interface = interface
        self._q_d, self._qd_d = self._arm.state()[0].copy(), np.zeros(self.joints)
        self._due = None

    def send(self, command: np.ndarray, last: bool = False) -> None:
        """The `command` [n]: velocities, rad/s, or torques besides gravity's, N m; `last`: from then on it
        stays where it is."""
        if not self._interface:
            raise ArmError(f"{self.name}: no motion was started.")
        if self._interface == "velocity":
            self._qd_d = np.array(command, float)
        else:
            self._torque = np.array(command, float)
        if last:
            self.stop()

    def dynamics(self) -> ArmDynamics:
        """By MuJoCo's model, the bias without gravity."""
        found = arm_dynamics(self.scene.model, self.data, self.scene.arm_dofs)
        return found._replace(bias=found.bias - self._gravity())

    def holding(self) -> np.ndarray:
        """A share of what would stop each joint's inertia in one period, and no more than its motor can do."""
        M = arm_dynamics(self.scene.model, self.data, self.scene.arm_dofs).mass_matrix
        return np.minimum(_OF_INERTIA * np.diagonal(M) / self.period, _OF_TORQUE * self.limits.torque)

    def hand_pose(self) -> np.ndarray | None:
        """None: the scene's arm is the policy's own."""
        return None

    def stop(self) -> None:
        """It holds the joints where they are."""
        if self._interface == "torque":
            self._q_d = self._arm.state()[0].copy()
        self._interface, self._qd_d = "", np.zeros(self.joints)

    def close(self) -> None:
        """Nothing to let go of."""

    def _passed(self) -> int:
        """How many cycles have passed since the last call; waits for the next one."""
        if not self._real_time:
            return 1
        now = time.perf_counter()
        if self._due is None:
            self._due = now
        passed = max(1, int((now - self._due) / self.period))
        self._due += passed * self.period
        if (left := self._due - time.perf_counter()) > 0:
            time.sleep(left)
        return min(passed, _MOST)

    def _pass(self) -> None:
        q, qd = self._arm.state()
        if self._interface == "torque":
            self._arm.push(self._torque + self._gravity())
        else:
            self._q_d = self._q_d + self.period * self._qd_d
            wanted = tracking_acceleration(0.0, self._q_d - q, self._qd_d - qd, _STIFFNESS, _DAMPING)
            self._arm.drive(wanted)
        self._arm.sense()

    def _gravity(self) -> np.ndarray:
        """Torques that hold the arm against gravity [n], N m: the bias of the same posture at rest."""
        from ..kinematics._mujoco import import_mujoco

        mujoco, data = import_mujoco(), self.data
        qvel = data.qvel.copy()
        data.qvel[:] = 0.0
        mujoco.mj_fwdVelocity(self.scene.model, data)
        gravity = (data.qfrc_bias - data.qfrc_passive)[self.scene.arm_dofs].copy()
        data.qvel[:] = qvel
        mujoco.mj_fwdVelocity(self.scene.model, data)
        return gravity


class SceneTracker:
    """The object of an `arm`'s scene as a `tracker` of trials sees it; with None, as it is.

    **Arguments**: `seed`, of the tracker's chance.
    """

    def __init__(self, arm: MujocoArm, tracker: Tracker | None = None, seed: int = 0):
        self._arm, self._tracker, self._number = arm, tracker, 0
        self._sight: Any = None if tracker is None else tracker.start(arm.scene, arm.data, (seed,))
        self._last = arm.scene.object_pose(arm.data)

    def newest(self) -> Sighting:
        """What the tracker last saw."""
        scene, data, none = self._arm.scene, self._arm.data, np.zeros((0, 4))
        if self._tracker is None:
            T = scene.object_pose(data)
            self._number += int((self._last != T).any())
            self._last = T
            return Sighting(T, none, 0.0, self._number)
        now, before = float(data.time), self._sight.stamp
        self._sight = self._tracker.observe(self._sight, now, scene, data)
        self._number += int(self._sight.stamp != before)
        return Sighting(self._sight.seen, none, self._tracker.age(self._sight, now), self._number)

    def close(self) -> None:
        """Nothing to let go of."""
