"""The hand that is taken where nobody names one."""

import pytest

from jaxrmp.kinematics import hand_frame, load_robot_from_string, panda


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


def test_the_panda():
    assert hand_frame(panda()) == "panda_hand_tcp"
