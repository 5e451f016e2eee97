"""Whether a robot has the arm of another one, such as one of two arms that were loaded together."""

import numpy as np

from ._robot import Joint, KinematicModel, Robot


def arm_differences(arm: Robot, robot: Robot, frame: str) -> list[str]:
    """What a `robot` has otherwise than the `arm`, or has not, by names, on the way to a body: none if it has that arm.

    Where the arm's first joint is may differ, and joints may move that are locked in the `arm`.

    **Arguments**: `frame` of the `arm`, fixed to the body.
    **Raises** `UnknownNameError` for a frame that is not there.
    """
    found, own, whole = [], arm.model, robot.model
    index = {other.name: i for i, other in enumerate(whole.bodies)}
    path = own.path(own.frames[arm.frame_index(frame)].body)
    moving = [any(own.joints[i].coordinate >= 0 for i in own.joints_of_body[b]) for b in path]
    first = moving.index(True) if any(moving) else len(path)
    for k in range(first, len(path)):
        name = own.bodies[path[k]].name
        if name not in index:
            found.append(f"body {name!r} is not there")
        elif k > first and not _same_place(own, whole, path[k], index[name]):
            found.append(f"body {name!r} sits elsewhere")
        elif not _same_joints(own, whole, path[k], index[name]):
            found.append(f"body {name!r} has other joints")
    return found


def _same_place(own: KinematicModel, whole: KinematicModel, body: int, other: int) -> bool:
    one, two = own.bodies[body], whole.bodies[other]
    parents = own.bodies[one.parent].name == whole.bodies[two.parent].name
    return parents and np.allclose((*one.position, *one.rotation), (*two.position, *two.rotation), atol=1e-9)


def _same_joints(own: KinematicModel, whole: KinematicModel, body: int, other: int) -> bool:
    """Whether joints move two bodies alike; a joint of the second may move that is locked in the first."""
    ones = [own.joints[i] for i in own.joints_of_body[body]]
    twos = [whole.joints[i] for i in whole.joints_of_body[other]]
    if [(j.name, j.kind) for j in ones] != [(j.name, j.kind) for j in twos]:
        return False
    return all(
        np.allclose((*one.axis, *one.anchor, one.reference), (*two.axis, *two.anchor, two.reference), atol=1e-9)
        and (one.coordinate < 0 <= two.coordinate or _position(own, one) == _position(whole, two))
        for one, two in zip(ones, twos, strict=True)
    )


def _position(model: KinematicModel, joint: Joint) -> tuple[str, float, float]:
    """What a joint's position follows: of a locked one, nothing."""
    leader = model.joint_names[joint.coordinate] if joint.coordinate >= 0 else ""
    return leader, round(joint.multiplier, 9), round(joint.offset, 9)
