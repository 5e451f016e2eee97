"""Frames' axes and relative points: against forward kinematics, autodiff and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ShapeError, UnknownNameError
from jaxrmp._task_map import pushforward_by_autodiff
from jaxrmp.kinematics import (
    ControlPoints,
    FrameAxes,
    FrameRotation,
    PointsInFrame,
    RelativePoints,
    forward_kinematics,
    panda,
)

FRAMES = {
    "panda": ("panda_hand", "panda_link2", "panda_link0"),
    "branching": ("right_hook", "site:left_lower", "world"),
}
SECOND = {"panda": "panda_link4", "branching": "left_tool"}


def rotation(robot, frame):
    return lambda q: forward_kinematics(robot, q, frame)[:3, :3]


def assert_carried_by_autodiff(task_maps, reference, expected, Q, QD):
    """Values, velocities, Jacobians and curvatures are those of plain functions, by autodiff.

    `reference` is a function of q that holds what all maps give, and `expected` takes from it (with any axes that a
    derivative puts behind) what each of them does: one program, and one differentiation, serves all.
    """

    @jax.jit
    @jax.vmap
    def carried(q, qd):
        ours = [(task_map.pushforward(q, qd), task_map(q)) for task_map in task_maps]
        return ours, pushforward_by_autodiff(reference, q, qd)

    with jax.enable_x64(True):
        ours, theirs = carried(Q, QD)
    for (found, value), of, task_map in zip(ours, expected, task_maps, strict=True):
        parts = jax.jit(lambda theirs, of=of: [jax.vmap(of)(part) for part in theirs])(theirs)
        np.testing.assert_allclose(value, parts[0], atol=1e-13)
        for name, a, b in zip(found._fields, found, parts, strict=True):
            assert a.shape == b.shape and a.dtype == np.float64, name
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-11, err_msg=name)
        single = jax.eval_shape(task_map.pushforward, Q[0].astype("float32"), QD[0].astype("float32"))
        assert {x.dtype.name for x in single} == {"float32"}


@pytest.fixture
def states(oracle, random_configurations):
    Q = random_configurations(oracle.robot, 50)
    return oracle.robot, Q, np.random.default_rng(2).normal(size=Q.shape)


@pytest.mark.parametrize("which", range(3))
def test_axes_and_rotation_agree_with_forward_kinematics(states, which):
    robot, Q, QD = states
    frame = FRAMES[robot.name][which]
    R = rotation(robot, frame)
    maps = FrameAxes(robot, frame, (2, 0)), FrameRotation(robot, frame)
    expected = (lambda R: R.swapaxes(0, 1)[np.array([2, 0])], lambda R: R.reshape(9, *R.shape[2:]))
    assert_carried_by_autodiff(maps, R, expected, Q, QD)


def test_relative_points_agree_with_autodiff(states):
    robot, Q, QD = states
    frame, other = FRAMES[robot.name][0], SECOND[robot.name]
    offsets = np.random.default_rng(3).uniform(-0.2, 0.2, (2, 2, 3))
    a, b = ControlPoints(robot, frame, offsets[0]), ControlPoints(robot, other, offsets[1])

    def both(q):
        T, points = forward_kinematics(robot, q, other), a(q)
        return jnp.stack([points - b(q), (points - T[:3, 3]) @ T[:3, :3]])

    maps = RelativePoints(a, b), PointsInFrame(robot, other, a)
    assert_carried_by_autodiff(maps, both, (lambda parts: parts[0], lambda parts: parts[1]), Q, QD)


def test_points_fixed_to_a_frame_do_not_move_in_it():
    robot = panda()
    offsets = np.random.default_rng(0).normal(size=(4, 3))
    with jax.enable_x64(True):
        q, qd = jnp.asarray(np.random.default_rng(1).normal(size=(2, 7)))
        within = PointsInFrame(robot, "panda_hand", ControlPoints(robot, "panda_hand", offsets))
        carried = jax.jit(within.pushforward)(q, qd)
    np.testing.assert_allclose(carried.y, offsets, atol=1e-13)
    for part in carried[1:]:
        np.testing.assert_allclose(part, 0, atol=1e-12)


def test_axes_are_velocities_of_a_rotation(oracle):
    """`sum_a y_a x yd_a = 2 omega`, and the Jacobian of the rotation is twice that of the angular velocity, squared."""
    robot, frame = oracle.robot, FRAMES[oracle.robot.name][0]
    q, qd = np.random.default_rng(4).uniform(0.1, 0.5, (2, robot.num_joints))
    with jax.enable_x64(True):
        maps = FrameAxes(robot, frame), FrameRotation(robot, frame)
        axes, turned = jax.jit(lambda q, qd: [task_map.pushforward(q, qd) for task_map in maps])(q, qd)
    axes, J = jax.tree.map(np.asarray, axes), np.asarray(turned.J)
    omega = np.cross(axes.y, axes.yd).sum(axis=0) / 2
    np.testing.assert_allclose(np.cross(omega, axes.y), axes.yd, atol=1e-12)
    J_omega = np.cross(axes.y[:, :, None], axes.J, axis=1).sum(axis=0) / 2
    np.testing.assert_allclose(J.T @ J, 2 * J_omega.T @ J_omega, atol=1e-12)


def test_gradients_reach_through_and_one_axis_may_be_named_alone():
    robot = panda()
    with jax.enable_x64(True):
        q, v = jnp.asarray(np.random.default_rng(5).normal(size=(2, 7)))
        push = jax.jit(lambda q: sum(jnp.sum(jnp.sin(x)) for x in FrameAxes(robot, "panda_hand", 2).pushforward(q, v)))
        slope = (push(q + 1e-6 * v) - push(q - 1e-6 * v)) / 2e-6
        np.testing.assert_allclose(jax.jit(jax.grad(push))(q) @ v, slope, rtol=1e-6)
    assert jax.eval_shape(FrameAxes(robot, "panda_hand", 2), q.astype("float32")).shape == (1, 3)


def test_mistakes_are_named():
    robot = panda()
    for make in (FrameAxes, FrameRotation):
        with pytest.raises(UnknownNameError, match="unknown frame 'hand'"):
            make(robot, "hand")
    with pytest.raises(UnknownNameError, match="unknown frame 'hand'"):
        PointsInFrame(robot, "hand", ControlPoints(robot, "panda_hand"))
    for axes in ((0, 3), (), (-1,)):
        with pytest.raises(ShapeError, match=r"axes is .*, expected one or more of 0 \(x\), 1 \(y\), 2 \(z\)"):
            FrameAxes(robot, "panda_hand", axes)
    with pytest.raises(ShapeError, match=r"q has shape \(6,\), expected \(7,\)"):
        FrameRotation(robot, "panda_hand")(jnp.zeros(6))
