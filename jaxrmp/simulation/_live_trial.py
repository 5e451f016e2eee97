"""One trial in native MuJoCo, millisecond by millisecond."""

import numpy as np

from .._pytree import single
from ..scenes import Left, Scene
from ._computed_torque import tracking_acceleration, within_velocity_limits
from ._judge import End
from ._object_tracker import Tracker
from ._physical_arm import PhysicalArm
from ._trials import Outcome, Trace, Trial

INTERFACES = ("torque", "velocity", "position")
DIVERGED = 5.0
"""Times its velocity limit at which a joint counts as diverged."""

_STIFFNESS = 400.0  # 1/s^2, of the position interface
_DAMPING = 40.0  # 1/s, of the position and velocity interfaces
_BRAKE = 10.0  # 1/s, how fast velocity dies when there is no pose to go by
_LOOK = 10  # steps between looks at clearance and success
_RECORD = 20  # steps between recorded samples


class LiveTrial(PhysicalArm):
    """A trial that is under way: an arm that follows a tracker, through an interface, and is watched.

    `there`, whether the scene's goal has been held for `hold` seconds; `touched`, what must not be and was; `world`,
    what the policy is told to avoid, and `obstacles_move`, whether that changes.
    """

    def __init__(
        self,
        scene: Scene,
        trial: Trial,
        hold: float,
        tracker: Tracker | None,
        interface: str,
        seed: tuple[int, ...],
    ):
        scene = scene.at(trial)
        super().__init__(scene, scene.data(trial.q))
        self.there, self.touched = False, list[str]()
        self.world, self.obstacles_move = single(scene.obstacles()), False
        self._trial, self._hold, self._tracker, self._interface = trial, hold, tracker, interface
        self._T = np.array(trial.T_world_object, float)
        self._sight = None if tracker is None else tracker.start(scene, self.data, seed)
        self._reference = (np.array(trial.q, float), np.zeros(len(trial.q)))
        self._dt = float(scene.model.opt.timestep)
        self._step = self._braked = self._limited = self._cut = self._good = 0
        self._cut_joints = np.zeros(len(trial.q), bool)
        self._hand, self._slow, self._least = None, False, np.inf
        self._records: list[tuple] = []

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return self._step * self._dt

    @property
    def T_seen(self) -> np.ndarray:
        """The object's pose [4, 4] as the policy believes it."""
        return self._T if self._sight is None else self._sight.seen

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities as measured; of the position interface those commanded, of the velocity interface
        the velocities commanded."""
        q, qd = super().state()
        q_ref, qd_ref = self._reference
        return (q_ref if self._interface == "position" else q), (qd if self._interface == "torque" else qd_ref)

    def sense(self) -> None:
        moves = self._trial.displacement
        if moves is not None and moves.start <= self.time < moves.start + moves.duration + self._dt:
            self.scene.move_object(self.data, moves.pose(self._trial.T_world_object, self.time))
        told = self.scene.moving_obstacles(self.data, self.time)
        if told is not None:
            self.world, self.obstacles_move = single(told), True
        super().sense()
        self._T = self.scene.object_pose(self.data)
        if self._tracker is not None:
            self._sight = self._tracker.observe(self._sight, self.time, self.scene, self.data)

    def act(self, qdd: np.ndarray) -> None:
        q, qd = super().state()
        q_ref, qd_ref = self._reference
        going = qd if self._interface == "torque" else qd_ref
        if self._tracker is not None and self._tracker.age(self._sight, self.time) > self._tracker.keep:
            qdd = -_BRAKE * going
            self._braked += 1
        wanted = allowed = within_velocity_limits(qdd, going, self._speed_limit)
        self._limited += int((allowed != qdd).any())
        if self._interface != "torque":
            qd_ref = qd_ref + self._dt * allowed
            q_ref = q_ref + self._dt * qd_ref
            self._reference = q_ref, qd_ref
            stiffness = _STIFFNESS if self._interface == "position" else 0.0
            wanted = tracking_acceleration(allowed, q_ref - q, qd_ref - qd, stiffness, _DAMPING)
        if self._step % _RECORD == 0:
            self._record()
        self.touched = self.scene.contacts(self.data) if self.data.ncon else []
        self.drive(wanted)
        self._cut += int(self.cut.any())
        self._cut_joints |= self.cut
        self._step += 1
        if self._step % _LOOK == 0 and np.isfinite(self.data.qpos).all():
            self._look()

    def trace(self) -> Trace:
        """The trial so far."""
        return Trace(*(np.array(column) for column in zip(*self._records, strict=True)))

    def outcome(self, end: End) -> Outcome:
        """How it ended; its last state is recorded."""
        self._record()
        if end != End.DIVERGED:
            self._least = min(self._least, self.scene.clearance(self.data))
        left = self.scene.left(self.data) if self.scene.judges else Left(False, "", np.nan)
        goal, steps = self.scene.goal, max(self._step, 1)
        still = "" if self._slow or np.isinf(self.scene.speed) else ", still moving"
        finite = np.isfinite(self.data.qpos).all() and np.isfinite(self.data.qvel).all()
        fast = (np.abs(super().state()[1]) >= DIVERGED * self._speed_limit).any()
        reasons = {
            End.CONVERGED: goal,
            End.TOUCHED: f"touched: {', '.join(self.touched)}",
            End.UNFINISHED: f"not {goal} after {self.time:.0f} s: {left.words}{still}",
            End.DIVERGED: f"diverged after {self.time:.2f} s"
            if fast or not finite
            else "diverged: the policy's acceleration is not finite",
        }
        return Outcome(
            end=end,
            reason=reasons[end],
            final_error_m=float(left.error),
            final_angle_deg=float(np.degrees(left.angle)),
            min_clearance_m=float(self._least),
            time_s=self.time,
            saturated=self._cut / steps,
            saturated_joints=tuple(np.array(self.scene.robot.joint_names)[self._cut_joints].tolist()),
            velocity_limited=self._limited / steps,
            braked_s=self._braked * self._dt,
            ignored=int(self.world.ignored),
            tracking=None if self._tracker is None else self._tracker.report(self._sight),
            left=left.words,
        )

    def _record(self) -> None:
        q, qd = super().state()
        seen = np.array(self.T_seen, float)
        self._records.append((self.time, self.data.qpos.copy(), q, qd, self.torque, self._T.copy(), seen))

    def _look(self) -> None:
        scene, moves, step = self.scene, self._trial.displacement, _LOOK * self._dt
        self._least = min(self._least, scene.clearance(self.data))
        if scene.hand:
            hand = scene.hand_pose(self.data)[:3, 3].copy()
            self._slow = self._hand is not None and bool(np.linalg.norm(hand - self._hand) < scene.speed * step)
            self._hand = hand
        good = scene.judges and scene.left(self.data).there and (self._slow or np.isinf(scene.speed))
        good = good and (moves is None or self.time >= moves.start + moves.duration)
        self._good = self._good + 1 if good else 0
        self.there = self._good * step >= self._hold
