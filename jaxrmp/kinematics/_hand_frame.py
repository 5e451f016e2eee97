"""Which frame of an arm is its hand, where nobody says so."""

import re

from ._robot import KinematicModel, Robot

_FINGER = re.compile(
    r"finger|gripper|jaw|knuckle|thumb|claw|driver|coupler|follower|(^|_)(index|middle|ring|little|pinky)_", re.I
)
_NO_HAND = re.compile(r"camera|optical|sensor|imu|force|torque|(^|_)ft(_|$)|light|led|laser|lidar|marker|finger", re.I)
# What hands are called, the most telling first.
_CALLED = [
    re.compile(pattern, re.I)
    for pattern in (
        r"tcp($|_)|pinch|grasp",
        r"tool0|tool_?frame|tool_?link|gripper_?frame|attachment|(^|_|:)eef?($|_)|end_?eff",
        r"hand|palm|gripper|tool|flange",
    )
]

_ARM, _HAND, _FINGER_JOINTS = 4, 3, 7  # joints of an arm, fingers of a hand at least; joints of a finger at most


def hand_frame(robot: Robot) -> str:
    """The frame of `robot` that is most likely its hand; of several hands, the last in the file.

    Of the frames that the most joints move, fingers' joints not counted: one with a hand's usual name, such as tcp,
    tool0, gripper or palm, else the last. Cameras, sensors and what fingers move are no hands.
    """
    model = robot.model
    finger = fingers_of(model)
    above = [_above(model, frame.body) for frame in model.frames]
    count = [len(set(joints) - finger) for joints in above]
    deepest = [k for k, n in enumerate(count) if n == max(count)]
    still = [k for k in deepest if finger.isdisjoint(above[k])] or deepest
    names = [model.frames[k].name for k in still]
    names = [name for name in names if not _NO_HAND.search(name)] or names
    for called in _CALLED:
        if found := [name for name in names if called.search(name)]:
            return found[-1]
    return names[-1]


def _above(model: KinematicModel, body: int) -> list[int]:
    """The moving joints between the world and a body."""
    return [i for b in model.path(body) for i in model.joints_of_body[b] if model.joints[i].coordinate >= 0]


def fingers_of(model: KinematicModel) -> set[int]:
    """Joints that are called fingers, or that are on three branches or more, all short, at the end of an arm."""
    fingers = {i for i, joint in enumerate(model.joints) if _FINGER.search(joint.name)}
    for palm in range(1, len(model.bodies)):
        arm = len(_above(model, palm))
        branches: dict[int, set[int]] = {}
        for body in range(palm + 1, len(model.bodies)):
            path = model.path(body)
            if palm in path[:-1]:
                branches.setdefault(path[path.index(palm) + 1], set()).update(_above(model, body)[arm:])
        moving = [joints for joints in branches.values() if joints]
        if arm >= _ARM and len(moving) >= _HAND and all(len(joints) <= _FINGER_JOINTS for joints in moving):
            fingers.update(*moving)
    return fingers
