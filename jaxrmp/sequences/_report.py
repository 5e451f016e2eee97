"""What is said of a sequence that was run: of each state how it ended, and what its certificate is worth."""

from typing import Any, NamedTuple

import numpy as np

from .._certificate import uncertified_leaves
from ..scenes._gripper import Width
from ._advance import Memory, Observation
from ._sequence import Sequence

_UNDER_WAY = "ended"


class StateReport(NamedTuple):
    """How one state went.

    `state`, its name; `end`: "arrived", "after", "timeout", or "ended" for the one in which the sequence failed;
    `seconds` in it, the gripper's included; `left_m` and `turn_deg`, of its aim at the end, NaN where nothing is to
    arrive; of its policy's energy V, which has a meaning within the state alone, `energy_start`, `energy_end`, and
    `energy_rise`, how far it was above the least before; `energy_jump`, by how much V differs from that of the policy
    before at the switch, 0 of the first; `uncertified`, the names of leaves that void the certificate; `gripper`, what
    the fingers were told at its end, None if nothing.
    """

    state: str
    end: str
    seconds: float
    left_m: float
    turn_deg: float
    energy_start: float
    energy_end: float
    energy_rise: float
    energy_jump: float
    uncertified: tuple[str, ...]
    gripper: Width | None


class SequenceOutcome(NamedTuple):
    """How a sequence went: `success`, whether it came through, `reason`, in words, `time_s`, and the `states` that it
    was in, in order."""

    success: bool
    reason: str
    time_s: float
    states: tuple[StateReport, ...]

    @property
    def jumps(self) -> int:
        """Switches from one policy to another, at each of which the energy may jump."""
        return max(len(self.states) - 1, 0)


class Energy(NamedTuple):
    """Of V within a state: where it `start`ed, is at `last`, the `least` so far, and the greatest `rise` above that."""

    start: float = float("nan")
    last: float = float("nan")
    least: float = float("inf")
    rise: float = 0.0

    def seeing(self, values: Any) -> "Energy":
        """The same after further `values` of V, in order."""
        values = np.atleast_1d(np.asarray(values, float))
        least = np.minimum.accumulate([self.least, *values])[1:]
        start = values[0] if np.isnan(self.start) else self.start
        rise = float(np.max([self.rise, *(values - least)]))  # NaN, where one is
        return Energy(float(start), float(values[-1]), float(least[-1]), rise)


class Book(NamedTuple):
    """What is kept of a run under way: the `states` that are over, the `energy` of the present one, and the V that the
    state before it ended with, `before`, None in the first."""

    states: tuple[StateReport, ...] = ()
    energy: Energy = Energy()
    before: float | None = None

    def turned(self, sequence: Sequence, memory: Memory, ahead: Memory, seen: Observation, tree: Any) -> "Book":
        """The book once the state of `memory`, whose policy is `tree`, was left for `ahead`, by what was `seen`."""
        over = len(ahead.past) > len(memory.past)
        state = sequence.states[memory.state]
        told = state.gripper if over and ahead.past[-1].end != "timeout" else None
        report = StateReport(
            state=state.name,
            end=ahead.past[-1].end if over else _UNDER_WAY,
            seconds=seen.time - memory.began,
            left_m=seen.distance if state.aim else float("nan"),
            turn_deg=float(np.degrees(seen.turn)) if state.aim and state.aim.turned else float("nan"),
            energy_start=self.energy.start,
            energy_end=self.energy.last,
            energy_rise=self.energy.rise,
            energy_jump=0.0 if self.before is None else self.energy.start - self.before,
            uncertified=uncertified_leaves(tree),
            gripper=told.width if told else None,
        )
        return Book((*self.states, report), Energy(), self.energy.last)

    def outcome(self, memory: Memory, time: float) -> SequenceOutcome:
        """The outcome of a sequence that has ended."""
        return SequenceOutcome(memory.ended == "done", memory.reason, time, self.states)
