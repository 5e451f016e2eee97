"""One step of a sequence: a pure function of plain values, whatever moves the arm."""

from typing import NamedTuple

from ._sequence import END, After, Sequence

_ROUNDING = 1e-9  # s


class Observation(NamedTuple):
    """What guards look at: `time`, s; of the present state's aim, `distance` to where it is to be, m, `turn`, rad, and
    `speed`, m/s."""

    time: float
    distance: float = float("inf")
    turn: float = 0.0
    speed: float = 0.0


class Passed(NamedTuple):
    """A state that is over: its number `state`, how it ended, `end`: "arrived", "after" or "timeout"; from when
    `began` to when `ended`, s."""

    state: int
    end: str
    began: float
    ended: float


class Memory(NamedTuple):
    """Where a sequence is.

    `state`, the number of the present one, `began`, s, when it began; `near`, s, since when its aim has been there, and
    `over`, s, since when its guard is met and the gripper acts, both None before that; `past`, the states so far;
    `ended`, "" while under way, then "done" or "failed", and `reason`, in words.
    """

    state: int = 0
    began: float = 0.0
    near: float | None = None
    over: float | None = None
    past: tuple[Passed, ...] = ()
    ended: str = ""
    reason: str = ""


def advance(sequence: Sequence, memory: Memory, observation: Observation) -> Memory:
    """Where a `sequence` is after an `observation`: the `memory` as it was is not changed.

    >>> from jaxrmp.sequences import After, State
    >>> two = Sequence((State("wait", None, After(1.0)), State("rest", None, After(2.0))))
    >>> advance(two, Memory(), Observation(0.5)).state, advance(two, Memory(), Observation(1.0)).state
    (0, 1)
    """
    time = observation.time
    if memory.ended:
        return memory
    state = sequence.states[memory.state]
    if time >= sequence.limit:
        reason = f"not done after {sequence.limit:g} s: in state {state.name!r}"
        return fail(memory, reason)
    if memory.over is not None:
        assert state.gripper is not None  # or the state would have been left
        waited = time - memory.over + _ROUNDING >= state.gripper.seconds
        return _leave(sequence, memory, _how(state.guard), sequence.after(memory.state), time) if waited else memory
    guard, spent = state.guard, time - memory.began + _ROUNDING
    if isinstance(guard, After):
        met = spent >= guard.seconds
    else:
        there = observation.distance <= guard.position and observation.turn <= guard.angle
        there = there and observation.speed <= guard.speed
        memory = memory._replace(near=(time if memory.near is None else memory.near) if there else None)
        met = memory.near is not None and time - memory.near + _ROUNDING >= guard.hold
        if not met and spent >= guard.timeout:
            if guard.otherwise is not None:
                return _leave(sequence, memory, "timeout", guard.otherwise, time)
            left = f"{100 * observation.distance:.1f} cm off"
            return fail(memory, f"state {state.name!r} has not arrived in {guard.timeout:g} s: {left}")
    if not met:
        return memory
    if state.gripper is not None:
        return memory._replace(over=time)
    return _leave(sequence, memory, _how(guard), sequence.after(memory.state), time)


def fail(memory: Memory, reason: str) -> Memory:
    """A sequence that ends here for a `reason`, in the state in which it is by its `memory`."""
    return memory._replace(ended="failed", reason=reason)


def left_state(before: Memory, ahead: Memory) -> bool:
    """Whether a state was left, or the sequence ended in it, between two memories."""
    return len(ahead.past) > len(before.past) or (ahead.ended != before.ended)


def _how(guard) -> str:
    return "after" if isinstance(guard, After) else "arrived"


def _leave(sequence: Sequence, memory: Memory, end: str, to: str, time: float) -> Memory:
    past = (*memory.past, Passed(memory.state, end, memory.began, time))
    if to == END:
        return Memory(memory.state, memory.began, past=past, ended="done", reason="all states are through")
    return Memory(sequence.index(to), time, past=past)
