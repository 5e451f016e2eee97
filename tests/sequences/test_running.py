"""Sequences that move an arm: kinematically, and in physics with its fingers."""

import re
from dataclasses import replace

import numpy as np
import pytest

from jaxrmp import ConfigurationError, RigidTransformError
from jaxrmp.cli._run_sequence import sequence_report, sequence_table
from jaxrmp.kinematics import forward_kinematics
from jaxrmp.sequences import After, Arrived, GripperMove, Sequence, roll_sequence, run_sequence
from jaxrmp.sequences._report import Energy
from jaxrmp.simulation import Trial

from .conftest import START, at

FINE = Arrived(position=0.01, speed=0.02)


def test_energy_falls_within_states_and_jumps_at_the_switch_alone(reaching, gripping):
    first = reaching("there", at(0.3, 0.4, 0.3), After(0.15), relative_to="world", gripper=GripperMove(0.03, 0.1))
    second = reaching("back", at(-0.2, 0.1), FINE)
    told = []
    path = roll_sequence(Sequence((first, second)), gripping, START, at(0.45, 0.3, 0.3), on_gripper=told.append)
    assert path.outcome.success and told == [GripperMove(0.03, 0.1)]
    there, back = path.outcome.states
    assert there.end == "after" and there.seconds == pytest.approx(0.25) and there.gripper == 0.03
    assert back.end == "arrived" and back.left_m < 0.01 and back.turn_deg < 10
    for report in (there, back):
        assert report.uncertified == () and report.energy_end < report.energy_start
        assert report.energy_rise < 1e-5 * report.energy_start
    assert back.energy_jump > 0.1 and path.outcome.jumps == 1
    end = forward_kinematics(gripping, path.q[-1].astype(np.float32), "grip")
    assert np.linalg.norm(np.asarray(end)[:3, 3] - [0.25, 0.4, 0.3]) < 0.01
    switch = np.flatnonzero(np.diff(path.state))[0]
    assert np.abs(path.qd[switch]).max() > 0.1  # nothing is brought to a stand for it
    assert np.abs(path.qd[switch + 1] - path.qd[switch]).max() < 0.6  # in 10 ms


def test_an_object_at_no_pose_is_told(reaching, gripping):
    wait = Sequence((reaching("wait", at(0.3, 0.4, 0.3), After(0.1)),))
    with pytest.raises(RigidTransformError, match="T_world_object is no rigid transform"):
        roll_sequence(wait, gripping, START, 2 * np.eye(4) - np.diag([0, 0, 0, 1.0]))


def test_an_energy_that_is_no_number_is_no_fall():
    assert Energy().seeing([3.0, 1.0, 1.5]).seeing(1.25).rise == 0.5
    assert np.isnan(Energy().seeing([3.0, np.nan]).seeing(1.0).rise)


def test_a_puck_is_gripped_and_carried_in_one_simulation(reaching, table):
    grasp = reaching("grasp", at(0.0, 0.0), FINE, gripper=GripperMove("close", 0.4))
    carry = reaching("carry", at(0.5, 0.15, 0.3, 0.2), FINE, relative_to="world")
    run = run_sequence(table, Sequence((grasp, carry)), [Trial(START, table.T_world_object)])
    (outcome,), (trace,) = run.outcomes, run.run.traces
    assert run.successes == 1, outcome.reason
    assert np.linalg.norm(trace.T_world_object[-1, :2, 3] - [0.5, 0.15]) < 0.01
    assert trace.time[-1] == pytest.approx(outcome.time_s, abs=0.03)
    assert np.abs(np.diff(trace.q, axis=0)).max() < 0.2  # no reset on the way
    assert [state.gripper for state in outcome.states] == ["close", None]
    said = sequence_table(sequence_report(run)).splitlines()
    assert [line.split()[:3] for line in said[1:3]] == [["0", "grasp", "arrived"], ["0", "carry", "arrived"]]
    assert said[3].startswith("trial 0: ") and said[3].endswith(" s, least clearance not checked")


def test_fingers_that_a_scene_holds_are_told_of_and_a_width_too_wide_is_refused(reaching, table):
    start = [Trial(START, table.T_world_object)]
    hold = Sequence((reaching("hold", at(0.0, 0.0), After(0.02), gripper=GripperMove("close", 0.02)),))
    told = []
    with pytest.warns(UserWarning, match="nothing moves: scene 'table' holds the fingers"):
        run_sequence(replace(table, gripper=None), hold, start, on_gripper=told.append)
    assert told == [GripperMove("close", 0.02)]
    wide = Sequence((replace(hold.states[0], gripper=GripperMove(0.2)),))
    with pytest.raises(ConfigurationError, match=r"gripper is 0.2, expected at most 0.1 m"):
        run_sequence(table, wide, start)
    with pytest.raises(ConfigurationError, match="which scene 'table' does not have"):
        run_sequence(replace(table, object=""), hold, start)


def test_what_must_not_be_touched_ends_it(reaching, table):
    through = Sequence((reaching("through", at(0.1, 0.0), Arrived(timeout=3.0)),))
    run = run_sequence(replace(table, may_touch=()), through, [Trial(START, table.T_world_object)])
    assert run.successes == 0 and "touched in state 'through'" in run.outcomes[0].reason
    assert run.outcomes[0].states[0].end == "ended" and run.run.outcomes[0].reason == run.outcomes[0].reason


def test_a_state_that_does_not_arrive_says_why(reaching, gripping):
    def reason(x, y, timeout):
        state = reaching("far", at(x, y, 0.3), Arrived(timeout=timeout, speed=0.01), relative_to="world")
        outcome = roll_sequence(Sequence((state,)), gripping, START).outcome
        assert not outcome.success and re.search(r"has not arrived in .* s: .* cm off; the arm", outcome.reason)
        return outcome.reason

    behind = r"came to rest there: other leaves hold the arm off, 'joint_limit' \(\d+ % of all forces\)"
    assert re.search(behind, reason(-0.88, -0.1, 15.0))  # the shoulder does not turn so far
    assert "came to rest there: no other leaf holds the arm off, so it is out of reach" in reason(0.0, 1.5, 8.0)
    assert "the arm still moves there: give it a longer timeout" in reason(0.0, 1.5, 0.3)
