"""Poses as pages take them: positions and quaternions."""

from typing import Any

import numpy as np

from .._rotations import pose, quaternion_of_rotation, rotation_of_quaternion


def pose_of(handle: Any) -> np.ndarray:
    """The pose [4, 4] of a gizmo, as it is on the page now."""
    return pose(handle.position, rotation_of_quaternion(handle.wxyz))


def place(handle: Any, T: np.ndarray) -> None:
    """Put something on a page at a pose [4, 4]."""
    handle.wxyz, handle.position = quaternion_of_rotation(T[:3, :3]), T[:3, 3]
