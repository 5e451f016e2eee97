"""Where bodies are, in NumPy: for a look at a few hundred configurations, for which compiling would take longest."""

import numpy as np

from .._rotations import pose, rotation_of_vector
from ._arranged import pose_of
from ._robot import Joint, KinematicModel


def body_poses(model: KinematicModel, q: np.ndarray) -> list[np.ndarray]:
    """The poses [N, 4, 4] of all bodies in the world, by index, in N configurations `q` [N, n], rad or m."""
    poses = [np.tile(np.eye(4), (len(q), 1, 1))]
    for b, body in enumerate(model.bodies[1:], 1):
        T = poses[body.parent] @ pose_of(body)
        for joint in (model.joints[i] for i in model.joints_of_body[b]):
            moved = joint.multiplier * q[:, joint.coordinate] if joint.coordinate >= 0 else np.zeros(len(q))
            T = T @ joint_motion(joint, moved + joint.offset)
        poses.append(T)
    return poses


def joint_motion(joint: Joint, position: np.ndarray) -> np.ndarray:
    """How a `joint` at `position` [N], rad or m, moves its body from where that is fixed, [N, 4, 4]."""
    along = (position - joint.reference)[:, None] * np.array(joint.axis)
    if joint.kind == "prismatic":
        return pose(along, np.eye(3))
    turn, anchor = rotation_of_vector(along), np.array(joint.anchor)
    return pose(anchor - turn @ anchor, turn)
