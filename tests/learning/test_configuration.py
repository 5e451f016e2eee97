"""Configurations: what is read, what is refused."""

from pathlib import Path

import pytest

from jaxrmp import ConfigurationError, UnknownNameError
from jaxrmp.learning import configuration_from_dict, configuration_to_dict, load_configuration

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize("task", ["drawer_closing", "door_reaching"])
def test_committed_configurations_survive_a_round_trip(task):
    configuration = load_configuration(CONFIGS / f"{task}.toml")
    assert configuration.name == task
    assert len(configuration.subtasks) == 3
    again = configuration_from_dict(configuration_to_dict(configuration))
    assert again == configuration
    assert hash(again) == hash(configuration)


def test_overrides_reach_sections_and_named_subtasks():
    overrides = {
        "metric.updates": 7,
        "seed": 3,
        "subtasks.gripper.frame": "panda_hand",
        "potential.widths": [0.05],
        "robot": "arm.urdf",
        "fixed_joints.gripper": 0,
        "policy.speed": 1,
    }
    configuration = load_configuration(CONFIGS / "drawer_closing.toml", overrides)
    assert configuration.metric.updates == 7
    assert configuration.seed == 3
    assert configuration.subtasks[0].frame == "panda_hand"
    assert configuration.subtasks[1].frame == "panda_link7"
    assert configuration.potential.widths == (0.05,)
    assert configuration.fixed_joints == {"gripper": 0.0}
    assert configuration.policy.speed == 1.0


@pytest.mark.parametrize(
    ("key", "value", "error", "message"),
    [
        ("metric.update", 5, UnknownNameError, "Did you mean 'updates'"),
        ("potentail.widths", [0.1], UnknownNameError, "Did you mean 'potential'"),
        ("subtasks.griper.frame", "x", UnknownNameError, "unknown subtask 'griper'. Did you mean 'gripper'"),
        ("metric.updates", "many", ConfigurationError, "metric.updates is 'many' .str., expected int"),
        ("metric.updates", True, ConfigurationError, "metric.updates is True"),
        ("metric.updates", 0, ConfigurationError, "metric.updates is 0, expected a positive number"),
        ("metric.hidden", [0], ConfigurationError, "metric.hidden is .0,., expected a positive number"),
        ("metric.spread", -1.0, ConfigurationError, "metric.spread is -1.0, expected a number that is not negative"),
        ("metric.activation", "gelu", UnknownNameError, "unknown activation 'gelu'"),
        ("metric.loss", "l1", UnknownNameError, "unknown loss 'l1'. Did you mean 'l2'|'smooth_l1'"),
        ("potential.basin_starts", 0, ConfigurationError, "potential.basin_starts is 0"),
        ("potential.widths", [], ConfigurationError, "potential.widths is .., expected a positive number"),
        ("seed", -1, ConfigurationError, "seed is -1"),
        ("name", "../x", ConfigurationError, "name is '../x', expected letters"),
        ("fixed_joints.a", 0.0, ConfigurationError, "the built-in Panda has none to fix"),
        ("policy.speed", -1.0, ConfigurationError, "policy.speed is -1.0, expected a positive number"),
        ("policy.joint_limit.barier", 0.1, UnknownNameError, "gain of JointLimit 'barier'. Did you mean 'barrier'"),
        ("policy.joint_limit.lower", 0.1, UnknownNameError, "gain of JointLimit 'lower'"),
        ("policy.joint_limit.reach", 0.0, ConfigurationError, "reach of JointLimit is 0.0, expected a positive number"),
        ("policy.joint_damping.weight", -1, ConfigurationError, "weight of Damping is -1.0, expected a number that is"),
        (
            "policy.joint_damping.weight",
            "1",
            ConfigurationError,
            "policy.joint_damping.weight is '1' .str., expected float",
        ),
        ("policy", 3, ConfigurationError, "policy is 3, expected a section"),
        ("seed.more", 3, ConfigurationError, "'seed' is no section"),
        ("subtasks", [], ConfigurationError, "at least one"),
        ("subtasks", [{"frame": "a"}], ConfigurationError, r"subtasks\[0\].name is missing"),
        ("subtasks.gripper.offset", [1.0, 2.0], ConfigurationError, r"expected 3 entries"),
        ("preprocessing.resample", "space", UnknownNameError, "unknown resampling 'space'"),
        ("preprocessing.filter_window", 0.0, ConfigurationError, "filter_window is 0.0"),
    ],
)
def test_values_that_make_no_sense_are_named(key, value, error, message):
    with pytest.raises(error, match=message):
        load_configuration(CONFIGS / "drawer_closing.toml", {key: value})


def test_a_missing_or_broken_file_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match=r"cannot read .*nowhere.toml"):
        load_configuration(tmp_path / "nowhere.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("name = ")
    with pytest.raises(ConfigurationError, match="no valid TOML"):
        load_configuration(broken)


def test_a_robot_file_is_found_from_the_configurations_folder(tmp_path):
    text = (CONFIGS / "drawer_closing.toml").read_text().replace('robot = "panda"', 'robot = "robots/arm.urdf"')
    (tmp_path / "arm.toml").write_text(text)
    assert load_configuration(tmp_path / "arm.toml").robot == str(tmp_path / "robots" / "arm.urdf")
    assert load_configuration(tmp_path / "arm.toml", {"robot": "here.urdf"}).robot == "here.urdf"


def test_examples_are_named_without_a_path(monkeypatch, tmp_path):
    file = Path(__file__).parents[2] / "configs" / "door_reaching.toml"
    expected = load_configuration(file)
    monkeypatch.chdir(tmp_path)
    assert load_configuration("door_reaching") == expected
    with pytest.raises(ConfigurationError, match="Examples, by their names alone: door_reaching, drawer_closing"):
        load_configuration("door_closing")
    (tmp_path / "door_reaching").write_text('name = "own"')  # a file of that name comes first
    with pytest.raises(ConfigurationError, match="subtasks"):
        load_configuration("door_reaching")
