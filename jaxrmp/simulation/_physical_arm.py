"""Arms in native MuJoCo, a millisecond at a time: one call of the policy for all of them, then a step of each."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..kinematics._mujoco import import_mujoco
from ..scenes import Scene
from ._computed_torque import Torque, arm_dynamics, computed_torque, within_velocity_limits
from ._judge import End, Track


class PhysicalArm:
    """An arm in a `scene`, driven by accelerations: computed torque within velocity and torque limits.

    `data`, its `mujoco.MjData`; `touching`, how many contacts it had in the last step; `torque` [n], what drove it, N
    m, and `cut` [n], which of it a limit cut.
    """

    def __init__(self, scene: Scene, data: Any):
        self._mujoco = import_mujoco()
        self.scene, self.data, self.touching = scene, data, 0
        n = scene.robot.num_joints
        self.torque, self.cut = np.zeros(n), np.zeros(n, bool)
        self._limit, self._speed_limit = scene.torque_limit, np.asarray(scene.robot.velocity_limit, float)
        self._places = scene.arm_qpos, scene.arm_dofs, scene.arm_actuators, scene.gear

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions and velocities [n] that the policy acts on."""
        return self.data.qpos[self._places[0]], self.data.qvel[self._places[1]]

    def sense(self) -> None:
        """Bring the world up to date before the policy is called."""
        self._mujoco.mj_step1(self.scene.model, self.data)

    def act(self, qdd: np.ndarray) -> None:
        """One step with the joint accelerations `qdd` [n] that the policy asks for."""
        self.drive(within_velocity_limits(qdd, self.data.qvel[self._places[1]], self._speed_limit))

    def drive(self, qdd: np.ndarray) -> None:
        """One step with the torques that give accelerations `qdd` [n], cut at the torque limits."""
        dynamics = arm_dynamics(self.scene.model, self.data, self._places[1])
        self._apply(computed_torque(dynamics, qdd, self._limit))

    def push(self, torque: np.ndarray) -> None:
        """One step with `torque` [n], N m, cut at the torque limits."""
        within = torque.clip(-self._limit, self._limit)
        self._apply(Torque(within, within != torque))

    def _apply(self, torque: Torque) -> None:
        model, data = self.scene.model, self.data
        _, _, actuators, gear = self._places
        self.torque, self.cut = torque
        data.ctrl[actuators] = self.torque / gear
        self.touching = int(self.scene.of_arm[data.contact.geom].any(1).sum()) if data.ncon else 0
        self._mujoco.mj_step2(model, data)


def step_all(
    arms: Sequence[PhysicalArm],
    track: Track,
    q: np.ndarray,
    qd: np.ndarray,
    command: Callable[[Track, np.ndarray, np.ndarray], tuple[Any, Track]],
) -> Track:
    """One millisecond of all arms that have not ended.

    **Arguments**: `arms`, B of them; `track`, of them all; `q`, `qd` [B, n], what the policy acts on, which this
    updates; `command`, the one call a millisecond: from all that to the accelerations [B, n] and the new track, by the
    judge.
    **Returns** the new track.
    """
    for i in np.flatnonzero(track.status == End.RUNNING).tolist():
        arms[i].sense()
    qdd, seen = command(track, q, qd)
    qdd = np.asarray(qdd, float)
    track = Track(*(np.array(part) for part in seen))
    for i in np.flatnonzero(track.status == End.RUNNING).tolist():
        arms[i].act(qdd[i])
        q[i], qd[i] = arms[i].state()
        track.touching[i] = arms[i].touching
        track.touched[i] += arms[i].touching > 0
    return track
