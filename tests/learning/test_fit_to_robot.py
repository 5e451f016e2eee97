"""Recordings that are not what they seem: wrapped angles, degrees, milliseconds, columns of fingers."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from jaxrmp import DemonstrationError, FileWarning
from jaxrmp.kinematics import load_robot_from_string
from jaxrmp.learning import Demonstration, DemonstrationSet, fit_to_robot

ARM = """<robot name="arm"><link name="base"/>
{}<joint name="finger_2" type="prismatic"><parent link="roll"/><child link="finger_2"/><axis xyz="0 1 0"/><limit
 lower="0" upper="0.04" velocity="1" effort="1"/><mimic joint="finger_1"/></joint>
<link name="finger_2"/></robot>"""
JOINT = """<link name="{1}"/><joint name="{1}" type="{2}"><parent link="{0}"/><child link="{1}"/><origin xyz="0 0 0.3"/>
<axis xyz="0 {3} 1"/><limit {4} effort="1"/></joint>"""
JOINTS = [
    ("base", "yaw", "continuous", 0, 'velocity="2"'),
    ("yaw", "shoulder", "revolute", 1, 'lower="-2" upper="2" velocity="2"'),
    ("shoulder", "elbow", "revolute", 1, 'lower="-6.28" upper="6.28" velocity="2"'),
    ("elbow", "lift", "prismatic", 0, 'lower="0" upper="0.5" velocity="1"'),
    ("lift", "roll", "continuous", 0, ""),
    ("roll", "finger_1", "prismatic", 1, 'lower="0" upper="0.04" velocity="1"'),
]
NAMES = ("yaw", "shoulder", "elbow", "lift", "roll")
YAW, SHOULDER, ELBOW, LIFT, ROLL = range(5)
FIRST, LAST = np.array([2.7, -0.5, 3.0, 0.1, -3.0]), np.array([3.6, 0.5, 3.4, 0.3, -3.4])


@pytest.fixture(scope="module")
def robot():
    return load_robot_from_string(ARM.format("".join(JOINT.format(*joint) for joint in JOINTS)), fixed={"finger_1": 0})


def recordings(change=None, which=(0, 1, 2), names=NAMES):
    """Three motions of all joints past half a turn; `change` makes of time and q what was recorded, in some of them."""
    time = np.linspace(0, 4, 120)
    s = (0.5 - 0.5 * np.cos(np.pi * time / 4))[:, None]
    each = [(time, FIRST + 0.05 * k * (1 - s) + (LAST - FIRST) * s) for k in range(3)]
    each = [change(t, q.copy()) if change and k in which else (t, q) for k, (t, q) in enumerate(each)]
    return DemonstrationSet(tuple(Demonstration(t, q) for t, q in each), names, "arm", "here")


def positions(demonstrations):
    return np.stack([d.q for d in demonstrations])


def scaled(*joints, by=180 / np.pi):
    def change(time, q):
        q[:, list(joints)] *= by
        return time, q

    return change


def wrap(time, q):
    q[:, [YAW, ELBOW, ROLL]] = (q[:, [YAW, ELBOW, ROLL]] + np.pi) % (2 * np.pi) - np.pi
    return time, q


def wrap_degrees(q):
    q[:, [YAW, ROLL]] = (np.rad2deg(q[:, [YAW, ROLL]]) + 180) % 360 - 180
    return q


def test_what_is_right_is_left_alone(robot):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fitted = fit_to_robot(recordings(), robot)
    np.testing.assert_array_equal(positions(fitted), positions(recordings()))


def test_angles_are_counted_through_where_a_recorder_wraps_them(robot):
    """The paths are those that were not wrapped, by whole turns the same in all demonstrations."""
    with pytest.warns(FileWarning, match=r"demonstration 0: joint 'yaw' jumps by a turn at sample \d+") as said:
        fitted = fit_to_robot(recordings(wrap), robot)
    assert "demonstration 2: joint 'roll' jumps" in str(said[0].message) and len(said) == 1
    turns = (positions(fitted) - positions(recordings())) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.broadcast_to(turns[0, 0].round(), turns.shape), atol=1e-12)


def test_a_wrap_that_would_leave_the_limits_is_brought_back(robot):
    def wrapped_from_zero(time, q):
        q[:, SHOULDER] %= 2 * np.pi
        return time, q

    with pytest.warns(FileWarning, match="demonstration 1: joint 'shoulder' jumps by a turn"):
        fitted = fit_to_robot(recordings(wrapped_from_zero), robot)
    np.testing.assert_allclose(positions(fitted), positions(recordings()), atol=1e-12)


def test_demonstrations_that_are_turns_off_the_others_are_brought_to_them(robot):
    def turned(time, q):
        q[:, [YAW, ROLL]] -= [2 * np.pi, -4 * np.pi]
        q[:, SHOULDER] += 2 * np.pi  # beyond its limits
        return time, q

    with pytest.warns(FileWarning, match=r"1: joint 'yaw' is 1 turns off .* 1: joint 'roll' is 2 turns off"):
        fitted = fit_to_robot(recordings(turned, which=(1,)), robot)
    np.testing.assert_allclose(positions(fitted), positions(recordings()), atol=1e-12)


def jump(by, joint=YAW, at=60):
    def change(time, q):
        q[at:, joint] += by
        return time, q

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (jump(4.5), r"demonstration 1: joint 'yaw' jumps by 4.5\d rad at sample 60, .* nor a whole turn"),
        (jump(-2.5), r"demonstration 1: joint 'yaw' jumps by -2.4\d rad at sample 60, faster than"),
        (jump(1.5, SHOULDER), r"demonstration 1: joint 'shoulder' jumps by 1.5\d rad at sample 60, faster than"),
        (scaled(SHOULDER), r"demonstration 1: joint 'shoulder' is .* rad outside its limits at sample .* degrees"),
        (scaled(ELBOW), r"demonstration 1: joint 'elbow' is .* outside its limits .* in degrees \(then say --units"),
        (scaled(ROLL), r"demonstration 1: joint 'roll' is at -19\d.* at sample 119, 31 turns .* degrees"),
        (scaled(YAW, SHOULDER, ELBOW, ROLL), r"demonstration 1: joint 'yaw' is at .* turns .* degrees"),
        (lambda t, q: scaled(YAW)(t, q - LAST), r"demonstration 1: joint 'yaw' is at .* turns.* degrees"),
        (scaled(LIFT, by=1000), r"demonstration 1: joint 'lift' is 3\d\d m outside .* millimetres .*/ 1000"),
        (lambda t, q: (1e3 * t, q), "demonstration 1 lasts 4000 s, 33.6 s .* like milliseconds. Divide them by 1e3"),
        (lambda t, q: (np.round(5e6 * t), scaled(YAW)(t, q)[1]), "demonstration 1 lasts 2e.07 s.* like microseconds"),
        (lambda t, q: (1e18 + 1e9 * t, q), "demonstration 1 lasts 4e.09 s.*nanoseconds"),
        (lambda t, q: (t / 1e3, q), "1: joint 'yaw' moves at .* its velocity limit is 2.*stamps not in s"),
        (lambda t, q: (t, wrap_degrees(q)), r"demonstration 1: joint '(yaw|roll)' is at .* degrees"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_by_demonstration_joint_and_sample(robot, change, message):
    with pytest.raises(DemonstrationError, match=message):
        fit_to_robot(recordings(change, which=(1,)), robot)


@pytest.mark.parametrize("joint", [YAW, ROLL])
def test_slow_degrees_near_zero_are_known_by_their_speed(robot, joint):
    """Ten degrees, of a joint without limits: 1.6 turns, less than what is refused for its size."""

    def change(time, q):
        q[:, joint] = 10 * (q[:, joint] - q[0, joint]) / np.ptp(q[:, joint])
        return time / 2, q

    with pytest.raises(DemonstrationError, match="moves at .* rad/s at sample .*in degrees"):
        fit_to_robot(recordings(change), robot)


def test_degrees_and_shares_of_the_range_become_radians_by_the_robot(robot):
    """Sliding joints are in metres with degrees; a joint without limits has no range."""
    degrees = replace(recordings(scaled(YAW, SHOULDER, ELBOW, ROLL)), units="degrees")
    np.testing.assert_allclose(positions(fit_to_robot(degrees, robot)), positions(recordings()), atol=1e-12)
    with pytest.raises(DemonstrationError, match=r"joints \['yaw', 'roll'\] of robot 'arm' have no limits"):
        fit_to_robot(replace(recordings(), units="normalised"), robot)


def test_a_short_slip_is_named_and_kept(robot):
    with pytest.warns(
        FileWarning, match="demonstration 1: joint 'shoulder' moves at .* its velocity limit is 2. That is"
    ):
        fit_to_robot(recordings(jump(0.7, SHOULDER), which=(1,)), robot)


def test_columns_of_fingers_are_left_out_where_the_robot_knows_them(robot):
    def with_fingers(names):
        some = recordings()
        each = (replace(d, q=np.concatenate([0.02 * np.ones((120, len(names))), d.q], axis=1)) for d in some)
        return DemonstrationSet(tuple(each), (*names, *NAMES), "arm", "here")

    with pytest.warns(FileWarning, match=r"columns of \['finger_1', 'finger_2'\] are left out"):
        fitted = fit_to_robot(with_fingers(("finger_1", "finger_2")), robot)
    np.testing.assert_array_equal(positions(fitted), positions(recordings()))
    with pytest.warns(FileWarning, match=r"\['gripper'\] are left out, since they are no joints of robot 'arm'"):
        fitted = fit_to_robot(with_fingers(("gripper",)), robot)
    np.testing.assert_array_equal(positions(fitted), positions(recordings()))
    few = DemonstrationSet(tuple(replace(d, q=d.q[:, :4]) for d in recordings()), NAMES[:4], "arm")
    with pytest.raises(DemonstrationError, match=r"\['roll'\] are not in the demonstrations.*fixed_joints"):
        fit_to_robot(few, robot)
