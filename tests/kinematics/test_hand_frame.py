"""The hand that is taken where nobody names one."""

import numpy as np
import pytest

from jaxrmp import UnknownNameError
from jaxrmp.kinematics import ControlPoints, hand_frame, idle_joints, load_robot_from_string, on_moving_links, panda


def arm(hand):
    """Five joints in a row, then what is at the wrist."""
    links = "".join(f'<body name="link{i}" pos="0 0 .2"><joint name="j{i}" axis="0 1 0"/>' for i in range(1, 6))
    return load_robot_from_string(f"<mujoco><worldbody>{links}{hand}{'</body>' * 5}</worldbody></mujoco>")


def finger(name, joint, rest=""):
    return f'<body name="{name}"><joint name="{joint}" type="slide" axis="0 1 0"/>{rest}</body>'


HANDS = {
    "nothing but the last link": ("", "link5"),
    "a tool, and a camera behind it": ('<body name="tool0"/><body name="wrist_camera_link"/>', "tool0"),
    "a camera alone is not it": ('<body name="wrist_3_optical_frame"/>', "link5"),
    "a site": ('<site name="attachment_site" pos="0 0 .1"/>', "attachment_site"),
    "the point between the fingers": (
        f'<body name="hand">{finger("left", "left_finger_joint")}{finger("right", "right_finger_joint")}'
        '<body name="hand_tcp" pos="0 0 .1"/></body>',
        "hand_tcp",
    ),
    "a gripper with parts of its own": (
        '<body name="gripper_base"><body name="gripper_motor_double"><body name="gripper_inner_single"/></body></body>',
        "gripper_base",
    ),
    "a jaw": (f'<body name="gripper">{finger("moving", "jaw")}</body>', "gripper"),
    "fingers by their number": (
        '<body name="mount"><body name="base">'
        + "".join(finger(f"f{i}0", f"f{i}0", finger(f"f{i}1", f"f{i}1")) for i in range(3))
        + "</body></body>",
        "base",
    ),
}


@pytest.mark.parametrize("what", HANDS)
def test_hands(what):
    hand, expected = HANDS[what]
    assert hand_frame(arm(hand)) == expected


def test_a_finger_alone_is_an_arm():
    links = "".join(f'<body name="l{i}"><joint name="finger_{i}" axis="0 1 0"/>' for i in range(3))
    robot = load_robot_from_string(f"<mujoco><worldbody>{links}{'</body>' * 3}</worldbody></mujoco>")
    assert hand_frame(robot) == "l2" and idle_joints(robot) == ()


def test_joints_that_move_no_hand():
    def side(name, more=""):
        links = "".join(
            f'<body name="{name}{i}" pos=".1 0 .1"><joint name="{name}{i}" axis="0 1 0"/>' for i in range(4)
        )
        return f"{links}<body name='{name}_hand'>{finger(f'{name}_l', f'{name}_jaw')}</body>{more}{'</body>' * 4}"

    head = '<body name="head"><joint name="nod" axis="0 1 0"/></body>'
    wheel = '<body name="wheel"><joint name="roll" axis="0 1 0"/></body>'
    robot = load_robot_from_string(
        '<mujoco><worldbody><body name="base"><joint name="lift" type="slide" axis="0 0 1"/>'
        f"{wheel}{side('left')}{side('right')}{head}</body></worldbody></mujoco>"
    )
    assert hand_frame(robot) == "right_hand"
    assert idle_joints(robot) == ("roll", "left_jaw", "right_jaw", "nod")
    assert idle_joints(robot, "head") == ("roll", "left_jaw", "right_jaw")
    with pytest.raises(UnknownNameError, match="tail"):
        idle_joints(robot, "tail")


def test_a_hand_stays_the_hand_when_its_fingers_are_locked():
    """A gripper without a usual name: one jaw is fixed, the other moves."""
    links = "".join(f'<body name="l{i}"><joint name="j{i}" axis="0 {i % 2} 1"/>' for i in range(4))
    moving = '<body name="Moving_Jaw"><joint name="jaw" axis="0 0 1"/></body>'
    text = f"<mujoco><worldbody>{links}<body name='Fixed_Jaw'>{moving}</body>{'</body>' * 4}</worldbody></mujoco>"
    free = load_robot_from_string(text)
    locked = load_robot_from_string(text, fixed=dict.fromkeys(idle_joints(free)))
    assert idle_joints(free) == ("jaw",) and locked.num_joints == 4
    assert hand_frame(free) == hand_frame(locked) == "Fixed_Jaw"


def test_points_of_what_is_rigidly_joined_are_points_of_the_link_that_a_joint_moves():
    robot, frames = panda(), ("panda_hand_tcp", "panda_link7", "panda_link0")
    offsets = np.array([[0.1, -0.2, 0.3], [0.0, 0.1, 0.0], [0.2, 0.0, 0.1]])
    links, moved = on_moving_links(robot, frames, offsets)
    assert links[:2] == ("panda_link7", "panda_link7") and links[2] not in robot.joint_names
    q = np.linspace(-0.5, 0.5, 7)
    points = [ControlPoints(robot, *given)(q) for given in ((frames, offsets), (links, moved))]
    np.testing.assert_allclose(*points, atol=1e-6)


def test_the_panda():
    assert hand_frame(panda()) == "panda_hand_tcp"
