"""Poses as pages take them: positions and quaternions."""

from typing import Any

import numpy as np

from ..kinematics._quaternions import rotation_of_quaternion


def quaternions(R: np.ndarray) -> np.ndarray:
    """Unit quaternions (w, x, y, z) [..., 4] of rotation matrices [..., 3, 3], the largest component positive."""
    R = np.asarray(R, float)
    xx, yy, zz = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    square = np.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], axis=-1)
    i, j, k = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    a, b, c = R[..., 1, 0] + R[..., 0, 1], R[..., 0, 2] + R[..., 2, 0], R[..., 2, 1] + R[..., 1, 2]
    rows = [(square[..., 0], i, j, k), (i, square[..., 1], a, b), (j, a, square[..., 2], c), (k, b, c, square[..., 3])]
    candidates = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)  # each 4 q_m q
    best = square.argmax(-1)[..., None, None]
    q = np.take_along_axis(candidates, best, axis=-2)[..., 0, :]
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def pose_of(handle: Any) -> np.ndarray:
    """The pose [4, 4] of a gizmo, as it is on the page now."""
    T = np.eye(4)
    quaternion = np.asarray(handle.wxyz, float)
    T[:3, :3] = rotation_of_quaternion(quaternion / np.linalg.norm(quaternion))
    T[:3, 3] = handle.position
    return T


def place(handle: Any, T: np.ndarray) -> None:
    """Put something on a page at a pose [4, 4]."""
    handle.wxyz, handle.position = quaternions(T[:3, :3]), T[:3, 3]
