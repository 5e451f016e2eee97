"""Which frame of an arm is its hand, where nobody says so."""

import re

from ._robot import KinematicModel, Robot

_FINGER = re.compile(
    r"finger|gripper|jaw|knuckle|thumb|claw|driver|coupler|follower|(^|_)(index|middle|ring|little|pinky)_", re.I
)
_NO_HAND = re.compile(
    r"camera|optical|sensor|imu|force|torque|(^|_)ft(_|$)|light|led|laser|lidar|marker|finger|knuckle|"
    r"(^|_)(inner|outer|motor|single|double|driver|coupler|follower)(_|$)",  # parts of a gripper
    re.I,
)
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
    tool0, gripper or palm, else the last. Cameras, sensors and what fingers move, locked or not, are no hands.
    """
    model = robot.model
    finger = fingers_of(model)
    above = [model.joints_above(frame.body) for frame in model.frames]
    deepest = _deepest(above, finger)
    whole = {k: model.joints_above(model.frames[k].body, locked=True) for k in deepest}
    still = [k for k in deepest if finger.isdisjoint(whole[k])] or deepest
    names = [model.frames[k].name for k in still]
    names = [name for name in names if not _NO_HAND.search(name)] or names
    for called in _CALLED:
        if found := [name for name in names if called.search(name)]:
            return found[-1]
    return names[-1]


def idle_joints(robot: Robot, hand: str | None = None) -> tuple[str, ...]:
    """The moving joints of `robot` that move neither the frame `hand`, by default `hand_frame`'s, nor a hand of another
    arm with as many joints: fingers, wheels, a head, in the file's order. A policy for hands leaves them where they
    are, so they may be locked: `load_robot(..., fixed=dict.fromkeys(idle_joints(robot)))`.

    **Raises** `UnknownNameError` for a frame that is not there.
    """
    model = robot.model
    finger = fingers_of(model)
    above = [model.joints_above(frame.body) for frame in model.frames]
    used = set().union(*(above[k] for k in _deepest(above, finger))) - finger
    used |= set(above[robot.frame_index(hand or hand_frame(robot))])
    leaders = {model.joints[i].coordinate for i in used}
    return tuple(name for i, name in enumerate(robot.joint_names) if i not in leaders)


def _deepest(above: list[list[int]], finger: set[int]) -> list[int]:
    """Which of the frames, by the joints `above` them, the most joints move, fingers' not counted."""
    count = [len(set(joints) - finger) for joints in above]
    return [k for k, n in enumerate(count) if n == max(count)]


def fingers_of(model: KinematicModel) -> set[int]:
    """Joints, locked or not, that are called fingers, or are on three short branches or more at the end of an arm; none
    where all are: a finger alone is an arm."""
    fingers = {i for i, joint in enumerate(model.joints) if _FINGER.search(joint.name)}
    for palm in range(1, len(model.bodies)):
        arm = len(model.joints_above(palm, locked=True))
        branches: dict[int, set[int]] = {}
        for body in range(palm + 1, len(model.bodies)):
            path = model.path(body)
            if palm in path[:-1]:
                below = model.joints_above(body, locked=True)[arm:]
                branches.setdefault(path[path.index(palm) + 1], set()).update(below)
        moving = [joints for joints in branches.values() if joints]
        if arm >= _ARM and len(moving) >= _HAND and all(len(joints) <= _FINGER_JOINTS for joints in moving):
            fingers.update(*moving)
    return fingers if len(fingers) < len(model.joints) else set()
