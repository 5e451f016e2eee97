"""What a trial in physics is: how it begins, what happens to it, how it ends."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ..scenes._parts import moved
from ._judge import End


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


class Trial(NamedTuple):
    """How one trial begins, and what happens on the way.

    `q` [n], rad; `T_world_object` [4, 4]; `displacement`; `changes`, what of the scene is different in this trial:
    values of its fields by name.
    """

    q: np.ndarray
    T_world_object: np.ndarray
    displacement: Displacement | None = None
    changes: Mapping[str, Any] = MappingProxyType({})


class Outcome(NamedTuple):
    """How a trial ended.

    `end`, an `End`: `CONVERGED` at the scene's goal, `TOUCHED`, `DIVERGED` or `UNFINISHED`; `reason`, in words;
    `final_error_m`, what is left to the goal, m; `final_angle_deg`, degrees, NaN where no angle is judged;
    `min_clearance_m`, least distance to what must not be touched, m, infinite where there is nothing such: not
    checked; `time_s`; `saturated`, the share of steps in which a torque limit cut in, and `saturated_joints`, at which
    joints; `velocity_limited`, the share in which a velocity limit did; `braked_s`, s without a pose to go by;
    `ignored`, how many of the obstacles that the policy was told of are not finite, and were ignored; `tracking`, what
    the tracker reports of it, None if nothing; `left`, what the scene says in words of what is left to its goal, such
    as "open by 3.1 mm", empty where it judges by none.
    """

    end: End
    reason: str
    final_error_m: float
    final_angle_deg: float
    min_clearance_m: float
    time_s: float
    saturated: float
    saturated_joints: tuple[str, ...]
    velocity_limited: float
    braked_s: float
    ignored: int = 0
    tracking: Any = None
    left: str = ""

    @property
    def success(self) -> bool:
        """Whether it ended at the goal."""
        return self.end == End.CONVERGED

    @property
    def diverged(self) -> bool:
        """Whether it was stopped for numbers or speeds that make no sense."""
        return self.end == End.DIVERGED


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
    """All trials of a run in a `scene`: how they began, `trials`, ended, `outcomes`, and went, `traces`."""

    scene: Any
    trials: tuple[Trial, ...]
    outcomes: tuple[Outcome, ...]
    traces: tuple[Trace, ...]

    @property
    def successes(self) -> int:
        """How many trials succeeded."""
        return sum(outcome.success for outcome in self.outcomes)
