"""Points of frames as points of the links that joints move."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ._arranged import pose_of
from ._body_poses import body_poses
from ._robot import Robot


def on_moving_links(robot: Robot, frames: Sequence[str], offsets: Any) -> tuple[tuple[str, ...], np.ndarray]:
    """The same K points, each in the frame of the link of `robot` that a joint moves and that its own is rigidly joined
    to, or of the world: fingers that are locked are parts of the hand so, and their poses are not asked for.

    **Arguments**: `frames`, of each point; `offsets` [K, 3], the points in them, m. **Returns** frames and offsets.
    **Raises** `UnknownNameError`.
    """
    model, poses = robot.model, body_poses(robot.model, np.zeros((1, robot.num_joints)))
    links, moved = [], []
    for name, offset in zip(frames, np.asarray(offsets, float), strict=True):
        frame = model.frames[robot.frame_index(name)]
        link = model.rigid_root(frame.body)
        T = np.linalg.inv(poses[link][0]) @ poses[frame.body][0] @ pose_of(frame)
        links.append(model.bodies[link].name)
        moved.append(T[:3, :3] @ offset + T[:3, 3])
    return tuple(links), np.reshape(moved, (-1, 3))
