"""What a URDF file says counts, by URDF's own rules: limits, names, couplings, the tree of links."""

import warnings

import numpy as np
import pytest

from jaxrmp import FileWarning, UnsafeFileWarning
from jaxrmp._errors import RobotError
from jaxrmp.kinematics import load_robot_from_string

LIMIT = '<limit lower="-1" upper="2" velocity="3" effort="9"/>'


def joint(name, parent, child, kind="revolute", inside=LIMIT):
    ends = f'<parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{inside}</joint>'


def urdf(*joints, links=("base", "arm", "hand"), more=""):
    return f'<robot name="r">{"".join(f"<link name={n!r}/>" for n in links)}{"".join(joints)}{more}</robot>'


def two(first="", **given):
    """Two joints in a row, of which `first` is what the first one says."""
    return urdf(joint("lift", "base", "arm", inside=first, **given), joint("turn", "arm", "hand"))


def limit(text):
    return f'<limit {text} velocity="1" effort="1"/>'


@pytest.mark.parametrize(
    ("given", "kind", "expected"),
    [
        ('lower="0" upper="0"', "revolute", (0, 0)),
        ('upper="1.5"', "revolute", (0, 1.5)),
        ('lower="-1.5"', "prismatic", (-1.5, 0)),
        ("", "prismatic", (0, 0)),
        ('lower="0.5" upper="0.5"', "revolute", (0.5, 0.5)),
        ('lower="-inf" upper="1"', "revolute", (-np.inf, 1)),
        ('lower="-1" upper="1"', "continuous", (-np.inf, np.inf)),
        ('lower="1" upper="-1"', "continuous", (-np.inf, np.inf)),
    ],
)
@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
def test_an_absent_bound_is_zero_and_a_continuous_joint_has_none(given, kind, expected):
    robot = load_robot_from_string(two(limit(given), kind=kind))
    assert (robot.lower[0], robot.upper[0]) == expected
    assert (robot.lower[1], robot.upper[1]) == (-1, 2)
    assert robot.velocity_limit.tolist() == [1, 3]


def test_a_locked_joint_is_held_to_the_files_own_limits():
    with pytest.raises(RobotError, match=r"outside the joint's range \[0.0, 1.5\]"):
        load_robot_from_string(two(limit('upper="1.5"')), fixed={"lift": -0.1})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (two(limit('lower="1" upper="-1"')), "joint 'lift' has a lower limit of 1 and an upper one of -1"),
        (two(limit('lower="nan" upper="1"')), "a limit of joint 'lift' is not a number"),
        (two(limit('upper="-1"')), "joint 'lift' has a lower limit of 0 and an upper one of -1"),
        (two(limit('lower="-1,5" upper="1"')), "joint 'lift' has lower limit '-1,5', expected a number"),
        (two(), "the revolute joint 'lift' has no limit"),
        (two(kind="prismatic"), "the prismatic joint 'lift' has no limit"),
        (two(LIMIT, kind="planar"), "joint 'lift' is a planar joint"),
        (two(LIMIT, kind="floating"), "joint 'lift' is a floating joint"),
        (two(LIMIT, kind="hinge"), "joint 'lift' is of type 'hinge'"),
        (two(LIMIT).replace(' type="revolute"', "", 1), "joint 'lift' is of type None"),
        (two(LIMIT + '<mimic joint="trun"/>'), "joint 'lift' mimics 'trun', which is no joint that moves"),
        (two(LIMIT + '<mimic joint="lift"/>'), "joint 'lift' mimics itself"),
        (two(LIMIT + "<mimic/>"), "joint 'lift' mimics ''"),
        (two(LIMIT + '<mimic joint="turn" multiplier="nan"/>'), "joint 'lift' has the mimic multiplier 'nan'"),
        (urdf(joint("pan", "base", "arm"), joint("pan", "base", "hand")), "the joint name 'pan' is there 2 times"),
        (urdf(joint("pan", "base", "arm"), links=("base", "arm", "arm")), "the link name 'arm' is there 2 times"),
        (urdf(joint("pan", "base", "arm"), joint("", "arm", "hand")), "a joint has no name"),
        (urdf(joint("pan", "bse", "arm")), "the parent of joint 'pan' is 'bse', which is no link"),
        (urdf(joint("pan", "base", "am")), "the child of joint 'pan' is 'am', which is no link"),
        (
            urdf(joint("a", "base", "arm"), joint("b", "arm", "hand"), joint("c", "base", "hand")),
            "link 'hand' is the child of two joints, 'b' and 'c'",
        ),
        (urdf(joint("a", "arm", "hand"), joint("b", "hand", "arm")), r"links \['arm', 'hand'\] hang on each other"),
        (urdf(joint("a", "base", "arm")), r"links \['base', 'hand'\] hang on no joint"),
        (urdf(joint("a", "base", "world"), links=("base", "world")), "link 'world' is moved by joint 'a'"),
        ("<robot name='r'/>", "there is no link"),
        (two(LIMIT).replace('xyz="0 0 1"', 'xyz="0 0 0"', 1), "axis too small"),
        (two(LIMIT + '<origin xyz="0 nan 0"/>'), "of body 'arm' is not finite"),
    ],
)
@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
def test_what_is_wrong_is_named(text, message):
    with pytest.raises(RobotError, match=message):
        load_robot_from_string(text)


@pytest.mark.parametrize(
    ("given", "kind", "message"),
    [
        ('<limit lower="-1" upper="1" velocity="0"/>', UnsafeFileWarning, r"\['lift'\] have a velocity limit that is"),
        ('<limit lower="-1" upper="1"/>', UnsafeFileWarning, r"\['lift'\] have a velocity limit that is absent"),
        ('<limit lower="-1" upper="1" velocity="nan"/>', UnsafeFileWarning, r"\['lift'\] have a velocity limit"),
        ('<limit velocity="1"/>', FileWarning, r"\['lift'\] cannot move: their limits are equal"),
        (
            '<limit lower="-inf" upper="1" velocity="1"/>',
            UnsafeFileWarning,
            r"\['lift'\] have a limit on one side alone",
        ),
        ('<limit lower="-180" upper="180" velocity="1"/>', UnsafeFileWarning, r"\['lift'\] .* are these degrees"),
        (
            '<limit lower="-1" upper="1" velocity="1"/><safety_controller soft_upper_limit="1"/>',
            FileWarning,
            r"\['lift'\] have soft limits",
        ),
    ],
)
def test_limits_that_cannot_be_meant_are_read_with_one_warning(given, kind, message):
    with pytest.warns(kind, match=message) as said:
        robot = load_robot_from_string(two(given))
    assert len(said) == 1
    assert robot.velocity_limit.tolist() == [1 if 'velocity="1"' in given else np.inf, 3]


def test_a_follower_that_would_cross_its_own_limits_is_told():
    with pytest.warns(UnsafeFileWarning, match=r"joints \['lift'\] follow others, whose limits count, beyond"):
        load_robot_from_string(two(LIMIT + '<mimic joint="turn" multiplier="2"/>'))


@pytest.mark.filterwarnings("error")
def test_soft_limits_that_are_none_or_no_tighter_say_nothing():
    for soft in ("", 'soft_lower_limit="-1" soft_upper_limit="2"', 'soft_lower_limit="-2" soft_upper_limit="3"'):
        load_robot_from_string(two(f'{LIMIT}<safety_controller k_velocity="1" {soft}/>'))


def test_a_sound_file_says_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_robot_from_string(two("", kind="continuous"))
        load_robot_from_string(two(LIMIT + '<mimic joint="turn" multiplier="0.5"/>'))


def test_a_mimic_of_a_fixed_joint_is_left_out_with_a_warning(capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where MuJoCo would write its log
    with pytest.warns(FileWarning, match=r"joints \['lift'\] are fixed, so their mimics are left out"):
        robot = load_robot_from_string(two('<mimic joint="turn"/>', kind="fixed"))
    assert robot.joint_names == ("turn",)
    assert capfd.readouterr() == ("", "") and not list(tmp_path.iterdir())


def test_mujocos_own_warnings_become_ours(capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    body = '<body pos="0 0 0"><joint name="j" user="NaN"/></body>'
    with pytest.warns(FileWarning, match="MuJoCo says: XML contains a 'NaN'"):
        load_robot_from_string(f'<mujoco><size nuser_jnt="1"/><worldbody>{body}</worldbody></mujoco>')
    assert capfd.readouterr() == ("", "") and not list(tmp_path.iterdir())


@pytest.mark.parametrize("joint", ['limited="false" range="-1 1"', 'range="1 -1"'])
def test_a_range_that_mujoco_does_not_use_is_told(joint):
    with pytest.warns(UnsafeFileWarning, match=r"joints \['j'\] have a range that is not used"):
        load_robot_from_string(f'<mujoco><worldbody><body><joint name="j" {joint}/></body></worldbody></mujoco>')


def test_a_joint_without_a_name_takes_nobody_elses():
    text = '<mujoco><worldbody><body><joint name="joint_1"/><joint axis="1 0 0"/></body></worldbody></mujoco>'
    with pytest.raises(RobotError, match="one joint is called 'joint_1'"):
        load_robot_from_string(text)


def test_a_limit_that_is_written_on_one_side_is_told_and_one_that_is_no_number_is_an_error():
    with pytest.warns(FileWarning, match="'lift'.*one limit alone"):
        load_robot_from_string(two(limit('upper="1.5"')))
    with pytest.raises(RobotError, match="'lift' is not a number"):
        load_robot_from_string(two(limit('lower="-1" upper="nan"')))
