"""Where bodies are, in NumPy: for a look at a few hundred configurations, for which compiling would take longest."""

import numpy as np

from .._rotations import pose, rotation_of_vector
from ._arranged import pose_of
from ._robot import KinematicModel


def body_poses(model: KinematicModel, q: np.ndarray) -> list[np.ndarray]:
    """The poses [N, 4, 4] of all bodies in the world, by index, in N configurations `q` [N, n], rad or m."""
    poses = [np.tile(np.eye(4), (len(q), 1, 1))]
    for b, body in enumerate(model.bodies[1:], 1):
        T = poses[body.parent] @ pose_of(body)
        for joint in (model.joints[i] for i in model.joints_of_body[b]):
            moved = joint.multiplier * q[:, joint.coordinate] if joint.coordinate >= 0 else np.zeros(len(q))
            along = (moved + joint.offset - joint.reference)[:, None] * np.array(joint.axis)
            if joint.kind == "prismatic":
                T = T @ pose(along, np.eye(3))
            else:
                turn, anchor = rotation_of_vector(along), np.array(joint.anchor)
                T = T @ pose(anchor - turn @ anchor, turn)
        poses.append(T)
    return poses
