"""One trial in native MuJoCo, millisecond by millisecond."""

from typing import Any

import numpy as np

from ..kinematics._mujoco import import_mujoco
from ..scenes import Scene
from ._computed_torque import arm_dynamics, computed_torque, tracking_acceleration, within_velocity_limits
from ._tracker import TrackerSettings, lost, observe, start_tracker
from ._trials import Criteria, Outcome, Trace, Trial

INTERFACES = ("torque", "velocity", "position")

_STIFFNESS = 400.0  # 1/s^2, of the position interface
_DAMPING = 40.0  # 1/s, of the position and velocity interfaces
_BRAKE = 10.0  # 1/s, how fast velocity dies when there is no pose to go by
_CHECK = 10  # steps between looks at clearance and success
_RECORD = 20  # steps between recorded samples
_DIVERGED = 5.0  # times the velocity limit


class LiveTrial:
    """A trial that is under way; `outcome` is None until it is over."""

    def __init__(
        self,
        scene: Scene,
        trial: Trial,
        criteria: Criteria,
        tracker: TrackerSettings | None,
        interface: str,
        seed: tuple[int, ...],
    ):
        self._mujoco = import_mujoco()
        self.scene = scene.with_object(trial.T_world_object)
        if trial.cylinder is not None:
            self.scene = self.scene.with_cylinder(trial.cylinder)
        self.data = self.scene.data(trial.q)
        self.outcome: Outcome | None = None
        self._trial, self._criteria, self._settings, self._interface = trial, criteria, tracker, interface
        self._limit = self.scene.model.actuator_ctrlrange[self.scene.arm_actuators, 1]
        self._speed_limit = np.asarray(self.scene.robot.velocity_limit)
        self._tcp = self.scene.model.site("panda_hand_tcp").id
        self._T = np.array(trial.T_world_object, float)
        self._tracker = None if tracker is None else start_tracker(tracker, seed, self._T)
        self._reference = (np.array(trial.q, float), np.zeros(len(trial.q)))
        self._torque = np.zeros(len(trial.q))
        self._step = self._braked = self._limited = self._cut = 0
        self._cut_joints = np.zeros(len(trial.q), bool)
        self._good, self._hand, self._least = 0, None, np.inf
        self._records: list[tuple] = []

    @property
    def T_seen(self) -> np.ndarray:
        """The object's pose [4, 4] as the policy believes it."""
        return self._T if self._tracker is None else self._tracker.seen

    def sense(self) -> tuple[np.ndarray, np.ndarray]:
        """Bring the world up to date; the joint positions and velocities [n] that the policy shall act on.

        Those measured; of the position interface the commanded ones, of the velocity interface the commanded velocity.
        """
        scene, data = self.scene, self.data
        time = self._step * scene.model.opt.timestep
        if self._trial.displacement is not None:
            self._T = self._trial.displacement.pose(self._trial.T_world_object, time)
            scene.move_object(data, self._T)
        if self._tracker is not None and self._settings is not None:
            self._tracker = observe(self._settings, self._tracker, time, self._T)
        self._mujoco.mj_step1(scene.model, data)
        q, qd = data.qpos[scene.arm_qpos], data.qvel[scene.arm_dofs]
        q_ref, qd_ref = self._reference
        return (q_ref if self._interface == "position" else q), (qd if self._interface == "torque" else qd_ref)

    def act(self, qdd: np.ndarray) -> None:
        """Take one step with the joint accelerations [n] that the policy wants; may end the trial."""
        scene, data = self.scene, self.data
        dt = scene.model.opt.timestep
        q, qd = data.qpos[scene.arm_qpos], data.qvel[scene.arm_dofs]
        q_ref, qd_ref = self._reference
        going = qd if self._interface == "torque" else qd_ref
        if self._tracker is not None and self._settings is not None and lost(self._settings, self._tracker, self.time):
            qdd = -_BRAKE * going
            self._braked += 1
        if not np.isfinite(qdd).all():
            return self._end(False, "diverged: the policy's acceleration is not finite", diverged=True)
        allowed = within_velocity_limits(qdd, going, self._speed_limit)
        self._limited += int((allowed != qdd).any())
        if self._interface == "torque":
            wanted = allowed
        else:
            qd_ref = qd_ref + dt * allowed
            q_ref = q_ref + dt * qd_ref
            self._reference = q_ref, qd_ref
            stiffness = _STIFFNESS if self._interface == "position" else 0.0
            wanted = tracking_acceleration(allowed, q_ref - q, qd_ref - qd, stiffness, _DAMPING)
        torque, cut = computed_torque(arm_dynamics(scene.model, data, scene.arm_dofs), wanted, self._limit)
        self._cut += int(cut.any())
        self._cut_joints |= cut
        self._torque = torque
        if self._step % _RECORD == 0:
            self._record()
        data.ctrl[scene.arm_actuators] = torque
        touched = scene.contacts(data) if data.ncon else []
        self._mujoco.mj_step2(scene.model, data)
        self._step += 1
        speed = np.abs(data.qvel[scene.arm_dofs])
        if not (np.isfinite(data.qpos).all() and (speed < _DIVERGED * self._speed_limit).all()):
            return self._end(False, f"diverged after {self.time:.2f} s", diverged=True)
        if touched:
            return self._end(False, f"touched: {', '.join(touched)}")
        if self._step % _CHECK == 0:
            self._check()
        return None

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return self._step * self.scene.model.opt.timestep

    def trace(self) -> Trace:
        """The trial so far."""
        columns = [np.array(column) for column in zip(*self._records, strict=True)]
        return Trace(*columns)

    def _record(self) -> None:
        scene, data = self.scene, self.data
        q, qd = data.qpos[scene.arm_qpos], data.qvel[scene.arm_dofs]
        self._records.append(
            (self.time, data.qpos.copy(), q, qd, self._torque, self._T.copy(), np.array(self.T_seen, float))
        )

    def _check(self) -> None:
        scene, criteria = self.scene, self._criteria
        self._least = min(self._least, scene.clearance(self.data))
        error, angle = self._errors()
        hand = self.data.site_xpos[self._tcp].copy()
        step = _CHECK * scene.model.opt.timestep
        slow = self._hand is not None and np.linalg.norm(hand - self._hand) < criteria.speed * step
        self._hand = hand
        if criteria.T_object_wrist is None:
            good = error <= criteria.closed
        else:
            good = error <= criteria.position and angle <= criteria.angle and slow
        moving = self._trial.displacement
        good = good and (moving is None or self.time >= moving.start + moving.duration)
        self._good = self._good + 1 if good else 0
        if self._good * step >= criteria.hold:
            self._end(True, "closed" if criteria.T_object_wrist is None else "at the standoff pose")
        elif self.time >= criteria.limit:
            self._end(False, self._shortcoming(error, angle, slow))

    def _errors(self) -> tuple[float, float]:
        """What is left to the goal: m, and rad where the wrist's pose is judged."""
        wanted = self._criteria.T_object_wrist
        if wanted is None:
            return abs(self.scene.joint_position(self.data)), float("nan")
        T = self._T @ wanted
        R = self.data.site_xmat[self._tcp].reshape(3, 3)
        angle = np.arccos(np.clip((np.trace(T[:3, :3].T @ R) - 1) / 2, -1.0, 1.0))
        return float(np.linalg.norm(self.data.site_xpos[self._tcp] - T[:3, 3])), float(angle)

    def _shortcoming(self, error: float, angle: float, slow: bool) -> str:
        if self._criteria.T_object_wrist is None:
            return f"not closed after {self.time:.0f} s: open by {1000 * error:.1f} mm"
        still = "" if slow else ", still moving"
        return (
            f"not at the standoff pose after {self.time:.0f} s: {100 * error:.1f} cm and {np.degrees(angle):.0f} "
            f"degrees off{still}"
        )

    def _end(self, success: bool, reason: str, diverged: bool = False) -> None:
        self._record()
        if not diverged:
            self._least = min(self._least, self.scene.clearance(self.data))
        error, angle = self._errors()
        steps = max(self._step, 1)
        names: Any = np.array(self.scene.robot.joint_names)
        self.outcome = Outcome(
            success=success,
            reason=reason,
            final_error_m=float(error),
            final_angle_deg=float(np.degrees(angle)),
            min_clearance_m=float(self._least),
            time_s=float(self.time),
            saturated=self._cut / steps,
            saturated_joints=tuple(names[self._cut_joints].tolist()),
            velocity_limited=self._limited / steps,
            braked_s=float(self._braked * self.scene.model.opt.timestep),
            diverged=diverged,
        )
