"""Rotation conversions: laws, both ways, at their edges, for NumPy and for JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp._rotations import nearest_rotation, pose, quaternion_of_rotation, rotation_of_quaternion, rotation_of_vector

pytestmark = pytest.mark.usefixtures("x64")
HALF_TURNS = np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])


def vectors(count=200):
    """Rotation vectors [count, 3] of up to a turn and more, among them none, tiny ones and half turns."""
    v = np.random.default_rng(0).normal(size=(count, 3)) * 2
    v[0] = 0
    v[1:4] = np.pi * np.eye(3)
    v[4:8] *= np.array([1e-12, 1e-8, 0.9e-6, 1.1e-6])[:, None] / np.linalg.norm(v[4:8], axis=1, keepdims=True)
    return v


@pytest.mark.parametrize("xp", [np, jnp])
def test_vectors_agree_with_quaternions_of_half_the_angle_and_come_back(xp):
    v = vectors()
    half = np.linalg.norm(v, axis=-1, keepdims=True) / 2
    q = np.concatenate([np.cos(half), v / 2 * np.sinc(half / np.pi)], axis=-1)
    R = rotation_of_vector(xp.asarray(v))
    np.testing.assert_allclose(R, rotation_of_quaternion(3 * xp.asarray(q)), atol=1e-14)
    back = np.asarray(quaternion_of_rotation(R))
    sign = np.sign((back * q).sum(-1, keepdims=True))
    np.testing.assert_allclose(sign * back, q, atol=1e-14)
    assert (np.take_along_axis(back, np.abs(back).argmax(-1)[:, None], -1) > 0).all()
    assert isinstance(R, jax.Array) == (xp is jnp)


@pytest.mark.parametrize("xp", [np, jnp])
def test_rotations_are_orthonormal_and_right_handed(xp):
    R = np.asarray(rotation_of_vector(xp.asarray(vectors())))
    np.testing.assert_allclose(np.swapaxes(R, -1, -2) @ R, np.broadcast_to(np.eye(3), R.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=1e-14)


def test_quarter_turns_have_the_right_sense():
    x, y, z = np.eye(3)
    for axis, start, end in ((x, y, z), (y, z, x), (z, x, y)):
        np.testing.assert_allclose(rotation_of_vector(np.pi / 2 * axis) @ start, end, atol=1e-15)


def test_identity_and_half_turns():
    np.testing.assert_array_equal(quaternion_of_rotation(np.eye(3)), [1, 0, 0, 0])
    np.testing.assert_array_equal(rotation_of_quaternion([1, 0, 0, 0]), np.eye(3))
    np.testing.assert_array_equal(rotation_of_vector(np.zeros(3)), np.eye(3))
    for k, R in enumerate(HALF_TURNS):
        np.testing.assert_array_equal(quaternion_of_rotation(R), np.eye(4)[k + 1])
        np.testing.assert_allclose(rotation_of_vector(np.pi * np.eye(3)[k]), R, atol=1e-15)


@pytest.mark.parametrize("v", [np.zeros(3), [0.0, 0.0, 1e-9], [0.5e-6, 0.0, 0.0], [0.3, -0.2, 0.4], [np.pi, 0.0, 0.0]])
def test_derivatives_exist_everywhere(v):
    v, h = np.asarray(v), 1e-6
    J, R = JACOBIAN(v)
    by_differences = [(rotation_of_vector(v + h * e) - rotation_of_vector(v - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(J, np.moveaxis(by_differences, 0, -1), atol=1e-9)
    np.testing.assert_allclose(np.tensordot(THERE_AND_BACK(R), J, 2), J, atol=1e-12)


JACOBIAN = jax.jit(lambda v: (jax.jacobian(rotation_of_vector)(v), rotation_of_vector(v)))
THERE_AND_BACK = jax.jit(jax.jacobian(lambda R: rotation_of_quaternion(quaternion_of_rotation(R))))


def test_second_derivatives_at_the_identity():
    H = jax.jit(jax.hessian(rotation_of_vector))(jnp.zeros(3))
    e = np.eye(3)
    skew = np.cross(e, e[:, None])  # skew[i] = [e_i]x, row by row
    expected = 0.5 * (np.einsum("aij,bjk->ikab", skew, skew) + np.einsum("bij,ajk->ikab", skew, skew))
    np.testing.assert_allclose(H, expected, atol=1e-12)


def test_single_precision_stays_single():
    with jax.enable_x64(False):
        q = quaternion_of_rotation(rotation_of_vector(jnp.array([0.1, 0.2, 0.3])))
    assert q.dtype == jnp.float32


def test_nearest_rotation_undoes_stretching_and_never_mirrors():
    R = rotation_of_vector(np.array([0.4, -1.0, 0.3]))
    np.testing.assert_allclose(nearest_rotation(R @ np.diag([2.0, 1.0, 0.5])), R, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(nearest_rotation(-R)), 1)


def test_poses_hold_position_and_rotation():
    R, p = rotation_of_vector(vectors()[:5]), np.arange(15.0).reshape(5, 3)
    T = pose(p, R)
    np.testing.assert_array_equal(T[:, :3, :3], R)
    np.testing.assert_array_equal(T[:, :3, 3], p)
    np.testing.assert_array_equal(T[:, 3], np.tile([0, 0, 0, 1], (5, 1)))
    np.testing.assert_array_equal(pose(p[0], R[0]), T[0])


def test_the_nearest_rotation_is_smooth_where_singular_values_are_equal():
    from jax.test_util import check_grads

    R = rotation_of_vector(np.array([0.3, -0.5, 0.8]))
    triangle = np.array([[1.0, 0.0, 0.0], [-0.5, 0.75**0.5, 0.0], [-0.5, -(0.75**0.5), 0.0]])
    for A in (R @ triangle.T @ triangle, R @ np.diag([2.0, 2.0, 2.0]), R @ np.diag([3.0, 1.0, -0.5])):
        check_grads(nearest_rotation, (jnp.asarray(A),), order=1, modes=["fwd", "rev"])
