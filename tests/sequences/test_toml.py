"""Sequences as files: read as written, and every mistake named with its line."""

import numpy as np
import pytest

from jaxrmp import ConfigurationError
from jaxrmp.cli import main
from jaxrmp.sequences import After, Arrived, GripperMove, load_sequence

from .conftest import ARM, START

GOOD = """limit = 30

[[state]]
name = "before"
reach = "grip"
position = [-0.1, 0.0, 0.0]
rpy_degrees = [0, 0, 30]
arrived = { position = 0.02, turn_degrees = 5, hold = 0 }
timeout = 4
on_timeout = "away"
gripper = 0.04
gripper_seconds = 0.5

[[state]]
name = "away"
reach = "grip"
relative_to = "world"
position = [0.3, 0.3, 0.3]
seconds = 2
then = "end"
"""


def test_a_file_becomes_the_sequence_that_it_says(tmp_path, table):
    file = tmp_path / "two.toml"
    file.write_text(GOOD)
    with pytest.warns(UserWarning, match="avoids neither"):
        sequence = load_sequence(file).on(table, START)
    before, away = sequence.states
    assert sequence.limit == 30
    assert before.guard == Arrived(0.02, np.radians(5), hold=0, timeout=4, otherwise="away")
    assert before.gripper == GripperMove(0.04, 0.5) and before.aim.turned and before.relative_to == "object"
    assert before.T_target[0, 0] == pytest.approx(np.cos(np.radians(30)))
    assert away.guard == After(2) and away.then == "end" and away.relative_to == "world" and not away.aim.turned


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("limit = 30", "limit = 0", r"line 1: limit is 0, expected a positive number"),
        ("limit = 30", "limits = 30", r"line 1: unknown key of a sequence 'limits'. Did you mean 'limit'"),
        ("timeout = 4", "timeout = true", r"line 9: timeout is True"),
        ("hold = 0", "held = 0", r"line 8: unknown key of arrived 'held'"),
        ("arrived = { position = 0.02, turn_degrees = 5, hold = 0 }", "arrived = 3", r"line 8: arrived is 3"),
        ('on_timeout = "away"', 'on_timeout = "awya"', r"line 10: unknown state for on_timeout 'awya'. Did you mean"),
        ("gripper = 0.04", 'gripper = "shut"', r"line 11: gripper is 'shut'"),
        ("gripper = 0.04\n", "", r"line 4: state 'before': gripper_seconds without gripper"),
        ('name = "away"', 'name = "before"', r"line 4: name is 'before': expected each name once"),
        ('name = "away"\n', "", r"line 10: unknown state for on_timeout"),
        ("[-0.1, 0.0, 0.0]", "[-0.1, 0.0]", r"line 6: position is \[-0.1, 0.0\], expected 3 finite numbers"),
        ('relative_to = "world"', 'relative_to = "wall"', r"line 17: unknown relative_to 'wall'"),
        (
            "seconds = 2\n",
            "seconds = 2\ntimeout = 3\n",
            r"line 15: state 'away' is over after its seconds: leave timeout",
        ),
        ('reach = "grip"\nrel', "rel", r"line 15: state 'away': expected either skill or reach"),
        ('reach = "grip"\nrelative_to = "world"', 'skill = "none.npz"', r"is of a skill, which has its own goal"),
        ("seconds = 2", "seconds = = 2", r"no valid TOML: .*line 19"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path, old, new, match):
    assert old in GOOD
    file = tmp_path / "two.toml"
    file.write_text(GOOD.replace(old, new))
    with pytest.raises(ConfigurationError, match=match):
        load_sequence(file)


def test_a_frame_that_the_robot_lacks_and_a_skill_that_is_not_there_are_named_with_their_lines(tmp_path, table):
    file = tmp_path / "two.toml"
    file.write_text(GOOD.replace('reach = "grip"', 'reach = "gripp"', 1))
    with pytest.raises(ConfigurationError, match=r"line 5: unknown frame.*'gripp'. Did you mean 'grip'"):
        load_sequence(file).on(table, START)
    file.write_text('[[state]]\nname = "a"\nskill = "none.npz"\n')
    with pytest.raises(ConfigurationError, match=r"line 3: there is no skill file 'none.npz'"):
        load_sequence(file)
    file.write_text("limit = 3\n")
    with pytest.raises(ConfigurationError, match=r"has no states: write \[\[state\]\]"):
        load_sequence(file)


def test_check_says_what_is_read_of_a_sequence_and_what_is_wrong(tmp_path, capsys):
    file = tmp_path / "two.toml"
    file.write_text(GOOD)
    assert main(["check", str(file)]) == 0
    said = capsys.readouterr().out
    assert "two.toml: sequence" in said and "states: before, away" in said
    file.write_text(GOOD.replace("seconds = 2", "seconds = -2"))
    assert main(["check", str(file)]) == 1
    assert "line 19: seconds is -2" in capsys.readouterr().out


def test_check_says_what_of_a_sequence_it_cannot_know_and_looks_at_the_arm_that_is_given(tmp_path, capsys):
    file, arm = tmp_path / "two.toml", tmp_path / "arm.xml"
    file.write_text(GOOD)
    arm.write_text(ARM)
    assert main(["check", str(file)]) == 0
    said = capsys.readouterr().out
    assert "its frames and its start were not checked: give the arm with --robot FILE" in said
    assert "nothing looks wrong" not in said
    assert main(["check", str(file), "--robot", str(arm)]) == 0
    said = capsys.readouterr().out
    assert "fits the robot: gripping" in said and "what a scene has was not checked" in said
    file.write_text("start = [0, 1]\n" + GOOD)
    assert main(["check", str(file), "--robot", str(arm)]) == 1
    assert "line 1: start has 2 numbers, and 'gripping' has 5 joints" in capsys.readouterr().out
    file.write_text(GOOD.replace('reach = "grip"', 'reach = "gripp"', 1))
    assert main(["check", str(file), "--robot", str(arm)]) == 1
    assert "line 5: unknown frame 'gripp'. Did you mean 'grip'" in capsys.readouterr().out
    assert main(["check", str(file), "--robot", str(tmp_path / "none.xml")]) == 1
    assert "none.xml" in capsys.readouterr().out


def test_a_start_of_another_arm_is_named_with_its_line(tmp_path, table):
    file = tmp_path / "two.toml"
    file.write_text("start = [0, 1]\n" + GOOD)
    with pytest.raises(ConfigurationError, match="line 1: start has 2 numbers, and 'gripping' has 3 joints"):
        load_sequence(file).on(table, START)


def test_a_name_that_is_no_text_is_none_that_another_state_may_lead_to(tmp_path):
    file = tmp_path / "two.toml"
    file.write_text(GOOD.replace('name = "away"', "name = [1]"))
    with pytest.raises(ConfigurationError, match="unknown state for on_timeout 'away'. Valid: before, end"):
        load_sequence(file)
