"""The step of a sequence is a function of plain values."""

import numpy as np
import pytest

from jaxrmp import ConfigurationError, ShapeError, UnknownNameError
from jaxrmp.sequences import (
    END,
    After,
    Aim,
    Arrived,
    GripperMove,
    Memory,
    Observation,
    Sequence,
    State,
    advance,
)

AIM = Aim(np.zeros(3), np.eye(4), "hand")
GUARD = Arrived(position=0.01, angle=0.1, speed=0.05, hold=0.2, timeout=5.0)


def state(name="a", guard=GUARD, **settings):
    return State(name, None, guard, AIM, **settings)


def run(sequence, *seen):
    memory = Memory()
    for each in seen:
        memory = advance(sequence, memory, Observation(*each))
    return memory


def test_an_arrival_is_near_turned_slow_and_held():
    two = Sequence((state("a"), state("b")))
    there = (0.005, 0.05, 0.01)
    assert run(two, (1.0, *there), (1.19, *there)).state == 0
    ahead = run(two, (1.0, *there), (1.2, *there))
    assert ahead.state == 1 and ahead.began == 1.2 and ahead.past[0] == (0, "arrived", 0.0, 1.2)
    for spoiled in ((0.02, 0.05, 0.01), (0.005, 0.2, 0.01), (0.005, 0.05, 0.1)):
        assert run(two, (1.0, *there), (1.1, *spoiled), (1.25, *there)).state == 0
    assert run(two, (1.0, *there), (1.2, *there), (1.3, *there), (1.5, *there)).ended == "done"


def test_the_gripper_acts_once_a_state_is_over_and_before_the_next():
    two = Sequence((state("a", After(1.0), gripper=GripperMove("close", 0.5)), state("b", After(1.0))))
    before = run(two, (0.99,))
    acting = run(two, (1.0,), (1.49, 1.0))  # whatever is seen meanwhile
    assert before.over is None and acting.over == 1.0 and acting.state == 0
    assert run(two, (1.0,), (1.5,)).state == 1
    assert [p[1] for p in run(two, (1.0,), (1.5,), (2.5,)).past] == ["after", "after"]


def test_what_does_not_arrive_goes_on_elsewhere_or_fails_and_says_why():
    far = (5.0, 0.123, 0.0, 0.0)
    failed = run(Sequence((state("a"), state("b"))), far)
    assert failed.ended == "failed" and "'a' has not arrived in 5 s: 12.3 cm off" in failed.reason
    elsewhere = Sequence((state("a", GUARD._replace(otherwise="c")), state("b"), state("c", After(1.0))))
    ahead = run(elsewhere, far)
    assert ahead.state == 2 and ahead.past[0].end == "timeout"
    assert run(elsewhere, far, (6.0,)).ended == "done"
    ends = Sequence((state("a", After(1.0), then=END), state("b")))
    assert run(ends, (1.0,)).ended == "done"


def test_round_and_round_ends_at_the_limit():
    ring = Sequence((state("a", After(1.0)), state("b", After(1.0), then="a")), limit=5.5)
    memory = run(ring, *((t,) for t in np.arange(0.5, 7.0, 0.5)))
    assert memory.ended == "failed" and "not done after 5.5 s: in state 'b'" in memory.reason
    assert [p.state for p in memory.past] == [0, 1, 0, 1, 0]


@pytest.mark.parametrize(
    ("make", "error", "match"),
    [
        (lambda: Sequence(()), ConfigurationError, "expected at least one"),
        (lambda: Sequence((state(), state())), ConfigurationError, "each named once"),
        (lambda: Sequence((state("a", then="b"),)), UnknownNameError, "then of state 'a'"),
        (lambda: Sequence((state("a", GUARD._replace(otherwise="x")),)), UnknownNameError, "otherwise of state"),
        (lambda: Sequence((state(),), limit=0.0), ConfigurationError, "limit is 0.0"),
        (lambda: state(guard=GUARD._replace(position=0.0)), ConfigurationError, "position is 0.0"),
        (lambda: state(gripper=GripperMove("shut")), ConfigurationError, "gripper is 'shut'"),
        (lambda: state(relative_to="hand"), UnknownNameError, "relative_to"),
        (lambda: state(T_target=np.tile(np.eye(4), (3, 1, 1))), ShapeError, r"'a' has shape \(3, 4, 4\)"),
        (lambda: State("a", None, GUARD), ConfigurationError, "has no aim"),
    ],
)
def test_mistakes_are_explained(make, error, match):
    with pytest.raises(error, match=match):
        make()
