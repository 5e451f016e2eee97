"""Forward kinematics against MuJoCo, against the Panda's public DH parameters, and its typed errors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp._errors import ShapeError, UnknownNameError
from jaxrmp.kinematics import forward_kinematics, frame_poses, panda
from jaxrmp.kinematics._body_poses import body_poses


@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-12), ("float32", 1e-6)])
def test_every_frame_agrees_with_mujoco(oracle, random_configurations, dtype, tolerance):
    robot = oracle.robot
    Q = random_configurations(robot, 1000).astype(dtype)
    with jax.enable_x64(dtype == "float64"):
        poses = np.asarray(jax.jit(jax.vmap(lambda q: frame_poses(robot, q, robot.frame_names)))(Q))
    assert poses.dtype == dtype
    for q, T in zip(Q, poses, strict=True):
        oracle.set(q)
        expected = np.stack([oracle.pose(name) for name in robot.frame_names])
        np.testing.assert_allclose(T[:, :3, 3], expected[:, :3, 3], rtol=0, atol=tolerance)
        np.testing.assert_allclose(T, expected, rtol=0, atol=tolerance * (1 if dtype == "float64" else 2))


def test_one_configuration_agrees_with_the_batch(oracle, random_configurations):
    robot = oracle.robot
    with jax.enable_x64(True):
        q = jnp.asarray(random_configurations(robot, 1)[0])
        frame = robot.frame_names[-1]
        alone = jax.jit(lambda q: forward_kinematics(robot, q, frame))(q)
        batch = jax.vmap(lambda q: forward_kinematics(robot, q, frame))(jnp.stack([q, 0.3 * q]))[0]
        np.testing.assert_allclose(alone, batch, atol=1e-14)


def test_bodies_in_numpy_are_where_mujoco_has_them(oracle, random_configurations):
    model = oracle.robot.model
    Q = random_configurations(oracle.robot, 50)
    poses = np.stack(body_poses(model, Q), axis=1)
    for q, T in zip(Q, poses, strict=True):
        oracle.set(q)
        expected = np.stack([oracle.pose(body.name) for body in model.bodies])
        np.testing.assert_allclose(T, expected, rtol=0, atol=1e-12)


def test_panda_agrees_with_its_public_dh_parameters(random_configurations):
    def modified_dh(a, d, alpha, theta):
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
        return np.array(
            [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]]
        )

    half = np.pi / 2
    table = [(0, 0.333, 0), (0, 0, -half), (0, 0.316, half), (0.0825, 0, half), (-0.0825, 0.384, -half)]
    table += [(0, 0, half), (0.088, 0, half)]
    with jax.enable_x64(True):
        robot = panda()
        names = [f"panda_link{i}" for i in range(1, 9)] + ["panda_hand", "panda_hand_tcp", "panda_leftfinger"]
        poses = jax.jit(lambda q: frame_poses(robot, q, names))
        for q in random_configurations(robot, 50):
            T, expected = np.eye(4), []
            for (a, d, alpha), theta in zip(table, q, strict=True):
                T = T @ modified_dh(a, d, alpha, theta)
                expected.append(T)
            expected.append(T @ modified_dh(0, 0.107, 0, 0))
            expected.append(T @ modified_dh(0, 0.107, 0, -np.pi / 4))
            expected.append(expected[-1] @ modified_dh(0, 0.1034, 0, 0))
            finger = np.eye(4)
            finger[:3, 3] = 0, 0.04, 0.0584
            expected.append(expected[-2] @ finger)
            np.testing.assert_allclose(poses(q), expected, rtol=0, atol=1e-12)


def test_first_and_second_derivatives(branching, random_configurations):
    with jax.enable_x64(True):
        q = jnp.asarray(random_configurations(branching, 1)[0])

        def height(q):
            return forward_kinematics(branching, q, "right_hook")[2, 3]

        @jax.jit
        def derivatives(around, q):
            values, gradients = jax.vmap(jax.value_and_grad(height))(around)
            return values, gradients, jax.jacfwd(jax.jacfwd(height))(q), jax.hessian(height)(q)

        n = len(q)
        steps = 1e-6 * np.concatenate([np.eye(n), -np.eye(n), np.zeros((1, n))])
        values, gradients, forwards, mixed = (np.asarray(part) for part in derivatives(q + steps, q))
        np.testing.assert_allclose(gradients[-1], (values[:n] - values[n:-1]) / 2e-6, atol=1e-8)
        np.testing.assert_allclose(forwards, (gradients[:n] - gradients[n:-1]) / 2e-6, atol=1e-8)
        np.testing.assert_allclose(mixed, forwards, atol=1e-13)


def test_works_inside_shard_map_scan_and_checkpoint(random_configurations):
    robot = panda()
    mesh = jax.make_mesh((1,), ("d",), axis_types=(jax.sharding.AxisType.Auto,))
    spec = jax.sharding.PartitionSpec("d")
    Q = random_configurations(robot, 4).astype("float32")

    def position(q):
        return forward_kinematics(robot, q, "panda_hand")[:3, 3]

    def total(q):
        return position(q).sum()

    @jax.jit
    def everywhere(Q):
        sharded = jax.shard_map(jax.vmap(position), mesh=mesh, in_specs=spec, out_specs=spec)(Q)
        scanned = jax.lax.scan(lambda carry, q: (carry, position(q)), 0, Q)[1]
        gradients = jax.vmap(lambda q: (jax.grad(total)(q), jax.grad(jax.checkpoint(total))(q)))(Q)
        return jax.vmap(position)(Q), sharded, scanned, gradients

    batch, sharded, scanned, (plain, checkpointed) = everywhere(Q)
    np.testing.assert_allclose(sharded, batch, atol=1e-6)
    np.testing.assert_allclose(scanned, batch, atol=1e-6)
    np.testing.assert_allclose(checkpointed, plain, atol=1e-6)


def test_a_base_frame_stands_still_and_integers_are_taken_as_positions():
    robot = panda()
    np.testing.assert_array_equal(forward_kinematics(robot, jnp.zeros(7), "world"), np.eye(4))
    np.testing.assert_allclose(forward_kinematics(robot, np.zeros(7, int), "panda_link1")[2, 3], 0.333, rtol=1e-6)


def test_mistakes_are_named():
    robot = panda()
    with pytest.raises(UnknownNameError, match=r"unknown frame 'panda_hnad'\. Did you mean 'panda_hand'"):
        forward_kinematics(robot, jnp.zeros(7), "panda_hnad")
    with pytest.raises(ShapeError, match=r"q has shape \(6,\), expected \(7,\) for 'panda'"):
        jax.jit(lambda q: forward_kinematics(robot, q, "panda_hand"))(jnp.zeros(6))
    with pytest.raises(ShapeError, match=r"q has shape \(2, 7\).*jax.vmap"):
        frame_poses(robot, jnp.zeros((2, 7)), ("panda_hand",))
