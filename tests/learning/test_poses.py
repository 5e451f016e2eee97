"""Skills from poses of a hand without joints: how a robot follows them, what is refused, how well they are learned."""

import json
import tomllib

import numpy as np
import pytest

from jaxrmp import ConfigurationError, DemonstrationError, FileWarning, ShapeError, UnknownNameError
from jaxrmp._rotations import rotation_of_vector
from jaxrmp.cli import main
from jaxrmp.kinematics import panda
from jaxrmp.learning import (
    PoseSettings,
    RecordingSettings,
    configuration_from_dict,
    configuration_to_dict,
    control_point_frames,
    load_demonstrations,
    load_skill,
    on_robot,
    turn_errors,
)

from .hand_paths import START, as_set, configuration_of, hand, pour, written

SAID = RecordingSettings(units="cm", quaternion="wxyz", rate=30.0)
CONFIGURATION = configuration_of("pour", "pose")


def test_the_hand_goes_through_every_pose_within_the_limits():
    robot, ways = panda(), [pour(0), pour(1, 60)]
    found = on_robot(as_set(ways), robot, "panda_hand", START)
    assert found.joint_names == robot.joint_names and found.units == "rad"
    for demonstration, T in zip(found, ways, strict=True):
        np.testing.assert_allclose(hand(demonstration.q), T, atol=1e-4)
        assert (demonstration.q > robot.lower).all() and (demonstration.q < robot.upper).all()
        assert np.abs(np.diff(demonstration.q, axis=0)).max() < 0.2
        assert demonstration.time[-1] == pytest.approx((len(T) - 1) / 30)


def test_signs_of_quaternions_say_nothing(tmp_path):
    settings = PoseSettings(start=tuple(START), frame="panda_hand")
    plain, flipped = (
        load_demonstrations(written(tmp_path, f"{flips}.npz", flips), SAID, panda(), poses=settings)
        for flips in (False, True)
    )
    for a, b in zip(plain, flipped, strict=True):
        np.testing.assert_allclose(a.q, b.q, atol=1e-9)


def test_they_are_put_where_the_start_posture_has_the_hand():
    """Objects go along; that the way of up is changed is told."""
    box = np.eye(4)
    box[:3, 3] = [0.5, 0.2, 0.3]
    poses, start = as_set([pour(0), pour(1)], {"box": box}), START + [0.3, 0, 0, 0, 0, 0, 0]
    with pytest.warns(FileWarning, match=r"are tilted by 1\d\d degrees"):
        found = on_robot(poses, panda(), "panda_hand_tcp", start, place="start")
    first = hand(start[None], "panda_hand_tcp")[0]
    begins = np.stack([hand(d.q[:1], "panda_hand_tcp")[0] for d in found])
    np.testing.assert_allclose(begins[:, :3, 3].mean(0), first[:3, 3], atol=1e-4)
    ends = np.stack([hand(d.q[-1:], "panda_hand_tcp")[0] for d in found])
    for T, d, end in zip((pour(0), pour(1)), found, ends, strict=True):
        np.testing.assert_allclose(np.linalg.inv(d.pose("box")) @ end, np.linalg.inv(box) @ T[-1], atol=1e-4)


def test_poses_that_a_robot_cannot_reach_are_refused_by_sample():
    far = pour(1)
    far[50:, 0, 3] += 0.6
    with pytest.raises(DemonstrationError, match=r"demonstration 1 .* sample 50, at .* off by [\d.]+ mm .* 'start'"):
        on_robot(as_set([pour(0), far]), panda(), "panda_hand", START)
    with pytest.raises(ShapeError, match=r"start has shape \(3,\), expected \(7,\)"):
        on_robot(as_set([pour(0), far]), panda(), "panda_hand", np.zeros(3))
    with pytest.raises(UnknownNameError, match="unknown place 'there'"):
        on_robot(as_set([pour(0), far]), panda(), "panda_hand", START, place="there")


def test_files_of_poses_ask_for_what_they_do_not_say(tmp_path):
    file, robot = written(tmp_path), panda()
    with pytest.raises(
        DemonstrationError, match=r"no joints(.|\n)*\[poses\]\nstart = \[0.00, .*\n?.*place = "
    ) as error:
        load_demonstrations(file, SAID, robot)
    shown = str(error.value).split("\n\n")[1]
    copied = configuration_from_dict(tomllib.loads(f"{CONFIGURATION.split('[poses]')[0]}{shown}"))
    np.testing.assert_allclose(copied.poses.posture(robot), robot.middle, atol=6e-3)
    with pytest.raises(DemonstrationError, match=r"of which frame of 'panda', poses.frame"):
        load_demonstrations(file, SAID, robot, poses=PoseSettings(start=tuple(START)))
    with pytest.raises(DemonstrationError, match="nothing says the units"):
        load_demonstrations(file, None, robot, poses=PoseSettings(tuple(START), frame="panda_hand"))
    by_name = PoseSettings(dict(zip(robot.joint_names, START, strict=True)))
    np.testing.assert_array_equal(by_name.posture(robot), START)
    with pytest.raises(ConfigurationError, match=r"has no \['panda_joint2', .*give a value"):
        PoseSettings({"panda_joint1": 0.0}).posture(robot)
    with pytest.raises(UnknownNameError, match="joint in poses.start 'elbow'"):
        PoseSettings({"elbow": 0.0}).posture(robot)
    with pytest.raises(ConfigurationError, match="has 2 numbers, but 'panda' has 7 joints"):
        PoseSettings((0.0, 1.0)).posture(robot)


def test_a_pose_is_a_subtask_of_its_own():
    content = {"name": "pour", "subtasks": [{"name": "cup", "frame": "panda_hand", "kind": "pose"}]}
    configuration = configuration_from_dict({**content, "poses": {"start": {"panda_joint1": 0.5}}})
    again = configuration_from_dict(configuration_to_dict(configuration))
    assert again == configuration and hash(again) == hash(configuration)
    assert configuration.followed.frame == "panda_hand"
    frames, offsets = control_point_frames(configuration)
    assert frames == ("panda_hand",) * 3
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), configuration.flow.circumradius)
    other = {"name": "tip", "frame": "panda_link7"}
    with pytest.raises(ConfigurationError, match="have a pose among them, .* leave the others out"):
        configuration_from_dict({**content, "subtasks": [*content["subtasks"], other]})
    with pytest.raises(ConfigurationError, match="'cup' is a pose, of which method 'paper' knows nothing"):
        configuration_from_dict({**content, "method": "paper"})
    with pytest.raises(UnknownNameError, match="unknown kind of subtask 'poses'. Did you mean 'pose'"):
        configuration_from_dict({**content, "subtasks": [{**content["subtasks"][0], "kind": "poses"}]})
    with pytest.raises(UnknownNameError, match="unknown poses.place 'here'"):
        PoseSettings(place="here")
    several = {**content, "subtasks": [{"name": "hand", "frame": "panda_hand"}, other], "poses": {"start": [0.0]}}
    assert configuration_from_dict(several).followed.frame == ""  # which `load_demonstrations` asks for, of poses only


def test_a_skill_is_learned_from_them_and_judged_by_place_and_turn(tmp_path, capsys):
    """By the command line, from a file that turns by 110 degrees, of which each demonstration ends otherwise turned."""
    file, config, out = written(tmp_path, flips=True), tmp_path / "pour.toml", tmp_path / "out"
    config.write_text(CONFIGURATION)
    assert main(["check", str(config), "--demos", str(file)]) == 0
    assert "cup: pose at (0.0, 0.0, 0.0) in panda_hand" in capsys.readouterr().out
    assert main(["learn", str(config), "--demos", str(file), "--out", str(out), "-q"]) == 0
    assert "goal_cm  position_percent  turn_deg  goal_turn_deg  energy_increase" in capsys.readouterr().out
    assert "<th>turn at the goal, degrees</th>" in (out / "report.html").read_text()
    skill = load_skill(out / "pour.skill.npz")
    assert skill.turned and skill.subtasks == ("cup_0", "cup_1", "cup_2")
    assert skill.configuration == configuration_from_dict(configuration_to_dict(skill.configuration))
    errors = tmp_path / "errors.json"
    assert main(["reproduce", str(out / "pour.skill.npz"), "--json", str(errors), "-q"]) == 0
    mean = json.loads(errors.read_text())["mean"]
    assert mean["position_percent"] < 3 and mean["turn_deg"] < 10 and mean["goal_turn_deg"] < 0.5
    assert mean["goal_cm"] < 0.1
    assert main(["learn", str(config), "--demos", str(file), "--out", str(out), "--poses.start", "[0.1]"]) == 1
    assert "poses.start has 1 numbers" in capsys.readouterr().err


def corners(positions, R):
    triangle = 0.15 * np.array([[1.0, 0.0, 0.0], [-0.5, 0.75**0.5, 0.0], [-0.5, -(0.75**0.5), 0.0]])
    return positions[:, None] + np.einsum("tij,kj->tki", R, triangle)


def test_errors_of_place_and_turn_do_not_see_speed():
    s = np.linspace(0, 1, 300)[:, None]

    def way(s, aside=0.0, turn=0.0):
        R = rotation_of_vector(s * [0.0, 2.0, 0.0]) @ rotation_of_vector(np.array([turn, 0.0, 0.0]))
        return corners(s * [0.4, 0.3, 0.0] + [0.0, 0.0, aside], R)

    assert max(turn_errors(way(s), way(s**2)).values()) < 0.2
    found = turn_errors(way(s), way(s, 0.01, 0.1))
    assert found["position_percent"] == pytest.approx(2.0, rel=1e-3)  # 1 cm of 50
    assert found["turn_deg"] == pytest.approx(np.degrees(0.1), rel=1e-3)
    assert found["goal_turn_deg"] == pytest.approx(np.degrees(0.1), rel=1e-3)
    still = turn_errors(way(s), way(s, turn=np.pi))
    assert still["goal_turn_deg"] == pytest.approx(180)
    with pytest.raises(ShapeError, match="hands have shapes"):
        turn_errors(way(s), way(s)[:, :2])
