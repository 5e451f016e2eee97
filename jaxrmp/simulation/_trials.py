"""What a trial in physics is: how it begins, what happens to it, how it ends."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .._errors import ConfigurationError


class Displacement(NamedTuple):
    """The object is moved while the arm moves.

    By `offset` [3], m, in the world, and `yaw`, rad, about the vertical through its origin, from `start` on, evenly
    over `duration`, s.
    """

    offset: np.ndarray
    yaw: float = 0.0
    start: float = 1.0
    duration: float = 0.5

    def pose(self, T: np.ndarray, time: float) -> np.ndarray:
        """Where an object at `T` [4, 4] at first is at `time`, s."""
        share = float(np.clip((time - self.start) / self.duration, 0.0, 1.0))
        return moved(T, share * np.asarray(self.offset, float), share * self.yaw)


def moved(T: np.ndarray, offset: np.ndarray, yaw: float) -> np.ndarray:
    """A pose [4, 4] moved by `offset` [3], m, in the world, and turned by `yaw`, rad, about the vertical through it."""
    c, s = np.cos(yaw), np.sin(yaw)
    there = np.array(T, float)
    there[:3, :3] = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ there[:3, :3]
    there[:3, 3] += offset
    return there


class Trial(NamedTuple):
    """How one trial begins, and what happens on the way.

    `q` [n], rad; `T_world_object` [4, 4]; `displacement`; `cylinder`, where it stands in the object's frame, m, None
    for the scene's own place.
    """

    q: np.ndarray
    T_world_object: np.ndarray
    displacement: Displacement | None = None
    cylinder: tuple[float, float] | None = None


@dataclass(frozen=True)
class Criteria:
    """When a trial has succeeded, and when it is over.

    The drawer: open by at most `closed`, m. The door: the gripper's centre within `position`, m, and the wrist within
    `angle`, rad, of `T_object_wrist` [4, 4], the demonstrated pose of `panda_hand_tcp` in the object's frame, at less
    than `speed`, m/s. Either for `hold` seconds on end, nothing forbidden having been touched, before `limit`, s.
    """

    T_object_wrist: np.ndarray | None = None
    closed: float = 0.005
    position: float = 0.01
    angle: float = float(np.radians(10.0))
    speed: float = 0.02
    hold: float = 1.0
    limit: float = 30.0

    def __post_init__(self):
        for name in ("closed", "position", "angle", "speed", "hold", "limit"):
            if not 0 < getattr(self, name) < np.inf:
                raise ConfigurationError(f"{name} is {getattr(self, name)!r}, expected a positive number.")


class Outcome(NamedTuple):
    """How a trial ended.

    `success`; `reason`, in words; `final_error_m`, what is left to the goal, m; `final_angle_deg`, degrees, NaN where
    the wrist's pose is not judged; `min_clearance_m`, least distance to what must not be touched, m; `time_s`;
    `saturated`, the share of steps in which a torque limit cut in, and `saturated_joints`, at which joints;
    `velocity_limited`, the share in which a velocity limit did; `braked_s`, s without a pose to go by; `diverged`.
    """

    success: bool
    reason: str
    final_error_m: float
    final_angle_deg: float
    min_clearance_m: float
    time_s: float
    saturated: float
    saturated_joints: tuple[str, ...]
    velocity_limited: float
    braked_s: float
    diverged: bool


class Trace(NamedTuple):
    """A trial as it went, at 50 Hz.

    `time` [T] s; `qpos` [T, nq] of the model; `q`, `qd`, `torque` [T, n]; `T_world_object`, `T_seen` [T, 4, 4], where
    the object was and where the policy believed it to be.
    """

    time: np.ndarray
    qpos: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray
    T_world_object: np.ndarray
    T_seen: np.ndarray


class Run(NamedTuple):
    """All trials of a run: how they began, ended and went. `scene`, where."""

    scene: Any
    trials: tuple[Trial, ...]
    outcomes: tuple[Outcome, ...]
    traces: tuple[Trace, ...]

    @property
    def successes(self) -> int:
        """How many trials succeeded."""
        return sum(outcome.success for outcome in self.outcomes)
