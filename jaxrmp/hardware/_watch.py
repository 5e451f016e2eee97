"""The watch-dog: what must not happen while an arm is driven, looked at in every cycle."""

import numpy as np

from .._errors import ConfigurationError
from .._ranges import BelowOne, NonNegative, Positive, settings
from ._arm import ArmState
from ._law import Step
from ._limits import MotionLimits
from ._sightings import Sighting

_TOO_FAST = 1.5  # times its velocity limit, as measured, that a joint may move at
LONGEST = 3600.0
"""Seconds that a drive may last: its log takes some 300 bytes a cycle."""


@settings("drive")
class DriveSettings:
    """How an arm is driven.

    `speed`, times that of the policy; `duration`, s, after which it is stopped. It rests, and is done, once no joint
    was faster than `still`, rad/s, for `hold` s, both of the policy's own time. It starts only within `near`, rad, of
    the posture that is stated. Sliding joints count in m.
    What stops it: a cycle that comes later than `late`, s; a sighting older than `keep`, s; a joint nearer than
    `margin`, rad, to the end of its range and moving there; one farther than `follow`, rad, from where it was told to
    be, or that moves one and a half times as fast as it may; energy that rose, while nothing was seen to change and
    nobody pushed, by the share `rise` of the largest so far.
    Torques from outside above `push`, N m, are somebody who pushes.
    """

    speed: Positive[float] = 1.0
    duration: Positive[float] = 60.0
    still: Positive[float] = 0.002
    hold: Positive[float] = 0.5
    near: Positive[float] = 0.1
    late: Positive[float] = 0.01
    keep: Positive[float] = 0.5
    margin: NonNegative[float] = 0.005
    follow: Positive[float] = 0.1
    rise: BelowOne[Positive[float]] = 0.1
    push: Positive[float] = 5.0

    def __post_init__(self):
        if self.speed > 2.0:
            raise ConfigurationError(f"drive.speed is {self.speed}, expected at most 2: the policy's own is 1.")
        if self.duration > LONGEST:
            raise ConfigurationError(
                f"drive.duration is {self.duration:g} s, expected at most {LONGEST:g}: every cycle is kept in memory."
            )


class Watch:
    """Looks at an arm in every cycle; `look` says why it must stop.

    **Arguments**: `settings`; `limits`, of the arm; `names`, of its joints; `certified`, whether the policy's energy
    may be watched.
    """

    def __init__(self, settings: DriveSettings, limits: MotionLimits, names: tuple[str, ...], certified: bool):
        self._settings, self._names, self._certified = settings, names, certified
        self._fastest = (_TOO_FAST * np.asarray(limits.velocity)).astype(np.float32)
        self._lower = np.asarray(limits.lower) + settings.margin
        self._upper = np.asarray(limits.upper) - settings.margin
        self._number, self._energy = -1, np.nan
        self._risen = self._least = self._largest = 0.0

    def look(self, state: ArmState, dt: float, seen: Sighting, step: Step) -> str:
        """Why the arm must stop, in words; empty if it may go on.

        **Arguments**: `state`; `dt`, s, since the last one; `seen`, the newest sighting; `step`, what the law gave.
        """
        settings = self._settings
        if not dt > 0:
            return f"the arm's clock went back, or stood still: by {dt:.3f} s from one cycle to the next"
        if dt > settings.late:
            return f"{1000 * dt:.0f} ms passed between two cycles: this process, or the network, was away"
        if seen.age > settings.keep:
            return f"the tracker is silent: its last pose is {seen.age:.2f} s old"
        energy, looked = float(step.energy), step.looked
        if not looked.finite and (self._certified or not np.isfinite(step.qd).all()):
            what = "energy" if np.isfinite(step.qd).all() and np.isfinite(step.wanted).all() else "acceleration"
            return f"the policy's {what} is not finite"
        if (np.abs(state.qd) > self._fastest).any():
            k = int(np.argmax(np.abs(state.qd) / self._fastest))
            return f"{self._names[k]} moves at {state.qd[k]:.2f} per second, {_TOO_FAST:g} times its limit or more"
        if not looked.apart <= settings.follow:
            return self._apart(state)
        if looked.end < settings.margin:
            return self._end(state, step)
        return self._rise(state, seen, step, energy) if self._certified else ""

    def _apart(self, state: ArmState) -> str:
        apart = np.abs(state.q - state.q_d)
        if not np.isfinite(apart).all():
            return "the arm's state is not finite"
        k = int(np.argmax(apart))
        return f"{self._names[k]} is {apart[k]:.2f} rad from where it was told to be: something is in its way"

    def _end(self, state: ArmState, step: Step) -> str:
        distance = np.where(
            step.qd < 0, state.q_d - self._lower, np.where(step.qd > 0, self._upper - state.q_d, np.inf)
        )
        k = int(np.argmin(distance))
        return f"{self._names[k]} is at the end of its range, at {state.q_d[k]:.3f}"

    def _rise(self, state: ArmState, seen: Sighting, step: Step, energy: float) -> str:
        push = self._settings.push
        pushed = bool((state.external > push).any() or (state.external < -push).any())  # NaN is no push
        same = seen.number == self._number and np.isfinite(self._energy) and not pushed
        # Where limits cut an acceleration, the arm is not where the policy would have taken it.
        if same and step.looked.free:
            self._risen += energy - self._energy
            self._least = min(self._least, self._risen)
        self._number, self._energy = seen.number, energy
        self._largest = max(self._largest, abs(energy))
        if self._risen - self._least > self._settings.rise * self._largest + 1e-4:
            share = (self._risen - self._least) / self._largest
            return f"the policy's energy rose by {share:.0%} of its largest while nothing was seen to change"
        return ""
