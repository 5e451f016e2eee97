"""Rotation matrices from unit quaternions and rotation vectors, and back; NumPy in, NumPy out, and JAX likewise."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ._linalg import lu_solve, matmul


def rotation_of_quaternion(wxyz: Any) -> Any:
    """The rotation matrices [..., 3, 3] of quaternions (w, x, y, z) [..., 4] of any length but zero."""
    xp, q = _module_and_array(wxyz)
    w, x, y, z = xp.moveaxis(q / xp.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_of_rotation(R: Any) -> Any:
    """Unit quaternions (w, x, y, z) [..., 4] of rotation matrices [..., 3, 3], the largest component positive."""
    xp, R = _module_and_array(R)
    xx, yy, zz = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    square = [1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz]
    i, j, k = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    a, b, c = R[..., 1, 0] + R[..., 0, 1], R[..., 0, 2] + R[..., 2, 0], R[..., 2, 1] + R[..., 1, 2]
    rows = [(square[0], i, j, k), (i, square[1], a, b), (j, a, square[2], c), (k, b, c, square[3])]
    candidates = xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)  # each 4 q_m q
    largest = xp.stack(square, axis=-1).argmax(-1)[..., None, None]
    q = xp.take_along_axis(candidates, largest, axis=-2)[..., 0, :]
    return q / xp.linalg.norm(q, axis=-1, keepdims=True)


def rotation_of_vector(turn: Any) -> Any:
    """The rotation matrices [..., 3, 3] of rotation vectors [..., 3], rad (Rodrigues); smooth at zero."""
    xp, v = _module_and_array(turn)
    square = xp.sum(v * v, axis=-1)[..., None, None]
    small = square < 1e-12  # where the quotients below have no derivative, and their limits are right to rounding
    angle = xp.sqrt(xp.where(small, 1, square))
    x, y, z = xp.moveaxis(v, -1, 0)
    zero, eye = xp.zeros_like(x), xp.eye(3, dtype=v.dtype)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    K = xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)
    first = xp.where(small, 1 - square / 6, xp.sin(angle) / angle)
    second = xp.where(small, 0.5, 2 * (xp.sin(angle / 2) / angle) ** 2)
    return eye + first * K + second * (v[..., None] * v[..., None, :] - square * eye)


def rotation_of_rpy(angles: Any) -> np.ndarray:
    """The rotation matrix [3, 3] of roll, pitch and yaw, rad: about the fixed x, then y, then z, as in URDF."""
    roll, pitch, yaw = rotation_of_vector(np.diag(np.asarray(angles, float)))
    return yaw @ pitch @ roll


def nearest_rotation(A: Any) -> Any:
    """The rotation matrix nearest to A [3, 3] in least squares; smooth, unless two of A's singular values are 0."""
    xp, A = _module_and_array(A)
    return _nearest(np, np.matmul, A) if xp is np else _nearest_in_jax(A)


def _nearest(xp: Any, product: Any, A: Any) -> Any:
    U, _, Vt = xp.linalg.svd(A)
    one = xp.ones((), A.dtype)
    return product(U * xp.stack([one, one, xp.sign(xp.linalg.det(product(U, Vt)))]), Vt)


@jax.custom_jvp
def _nearest_in_jax(A: jax.Array) -> jax.Array:
    return _nearest(jnp, matmul, A)


@_nearest_in_jax.defjvp
def _nearest_slope(primals, tangents):
    """With `R S = A`, S symmetric, R turns by w with `(tr(S) I - S) w = vee(R^T dA - dA^T R)`: singular values that are
    equal, as an equilateral triangle's, are no matter, as they are to the derivative of their decomposition."""
    (A,), (dA,) = primals, tangents
    R = _nearest_in_jax(A)
    S, B = matmul(R.T, A), matmul(R.T, dA)
    S = (S + S.T) / 2
    v = jnp.stack([B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1]])
    x, y, z = lu_solve(jnp.trace(S) * jnp.eye(3, dtype=A.dtype) - S, v)
    zero = jnp.zeros_like(x)
    turn = jnp.stack([jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])])
    return R, matmul(R, turn)


def rotation_angle(R: np.ndarray) -> np.ndarray:
    """The angles [...], rad, by which rotation matrices [..., 3, 3] turn; to rounding near none and a half turn too."""
    R = np.asarray(R)
    twice = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)
    return np.arctan2(np.linalg.norm(twice, axis=-1), np.trace(R, axis1=-2, axis2=-1) - 1)


def pose(position: Any, R: Any) -> np.ndarray:
    """The rigid transforms [..., 4, 4] of `position` [..., 3] and rotation `R` [..., 3, 3]."""
    T = np.zeros((*np.shape(position)[:-1], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, position, 1.0
    return T


def _module_and_array(value: Any) -> tuple[Any, Any]:
    return (jnp, value) if isinstance(value, jax.Array) else (np, np.asarray(value, float))
