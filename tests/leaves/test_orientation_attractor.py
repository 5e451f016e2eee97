"""The orientation attractor: against the geometry of SO(3), and from anywhere to the goal."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.scipy.linalg import expm
from jax.tree_util import Partial

from jaxrmp import ConfigurationError, RigidTransformError, ShapeError, acceleration, pullback
from jaxrmp.kinematics import FrameRotation, forward_kinematics, panda
from jaxrmp.leaves import Damping, JointLimit, OrientationAttractor
from jaxrmp.simulation import rollout

pytestmark = pytest.mark.usefixtures("x64")
ROUNDINGS = [1.0, 0.05]


def skew(w):
    return jnp.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def turned(R, w):
    """Cayley's chart of SO(3) around R, as a vector [9]: to second order in w it is `R exp(w)`."""
    K = skew(w)
    return (R @ (jnp.eye(3) + (K + K @ K / 2) / (1 + w @ w / 4))).reshape(9)


def random_rotations(count, seed=0):
    Q, R = np.linalg.qr(np.random.default_rng(seed).normal(size=(count, 3, 3)))
    Q *= np.sign(np.diagonal(R, axis1=1, axis2=2))[:, None, :]
    return Q * np.linalg.det(Q)[:, None, None] ** np.array([0, 0, 1])


def goal_leaf(rounding=0.05, **gains):
    gains = dict(weight=2.0, stiffness=9.0, damping_rate=6.0) | gains
    return OrientationAttractor(jnp.asarray(random_rotations(1, seed=5)[0]), rounding=rounding, **gains)


@pytest.mark.parametrize("rounding", ROUNDINGS)
def test_metric_energy_and_torque_along_geodesics(rounding):
    leaf, c = goal_leaf(rounding), 1 - rounding
    potential, turn = jax.jit(leaf.potential), jax.jit(lambda angle, axis: expm(skew(angle * axis)))
    run = jax.jit(lambda R: pullback(Partial(turned, R), leaf)(jnp.zeros(3), jnp.zeros(3)))
    for axis in random_rotations(4)[:, 0]:
        for angle in (0.0, 1e-6, 0.3, 1.5, 2.8, 3.1, np.pi):
            R = leaf.R_world_goal @ turn(angle, axis)
            form = run(R)
            np.testing.assert_allclose(form.M, 2.0 * np.eye(3), atol=1e-12)  # weight per rad^2, in every direction
            torque = 2.0 * 9.0 * np.sin(angle) / np.sqrt(1 - c * np.sin(angle / 2) ** 2)
            np.testing.assert_allclose(form.f, -torque * axis, atol=1e-11)
            if rounding == 1:
                trace = np.trace(leaf.R_world_goal.T @ R)
                np.testing.assert_allclose(potential(R.reshape(9)), 18.0 * (3 - trace) / 2, atol=1e-12)


@pytest.mark.parametrize("rounding", ROUNDINGS)
def test_stiffness_at_the_goal_is_per_radian(rounding):
    leaf = goal_leaf(rounding)
    hessian = jax.jit(jax.hessian(lambda w: leaf.potential(turned(leaf.R_world_goal, w))))(jnp.zeros(3))
    np.testing.assert_allclose(hessian, 2.0 * 9.0 * np.eye(3), atol=1e-10)


def test_the_potential_rises_all_the_way_to_half_a_turn_and_only_there_is_it_stationary():
    leaf = goal_leaf()
    axis = jnp.array([2.0, -1.0, 2.0]) / 3
    slope_at = jax.grad(lambda t: leaf.potential((leaf.R_world_goal @ expm(skew(t * axis))).reshape(9)))
    slope = jax.jit(jax.vmap(slope_at))(jnp.linspace(1e-3, np.pi - 1e-3, 300))
    assert (slope > 0).all()
    top = jax.grad(lambda w: leaf.potential(turned(leaf.R_world_goal @ expm(skew(np.pi * axis)), w)))
    top = jax.jit(top)(jnp.zeros(3))
    np.testing.assert_allclose(top, 0, atol=1e-10)


def test_five_hundred_random_orientations_converge():
    """A free body: `omega` in its own axes, integrated on SO(3) itself."""
    leaf, dt = goal_leaf(), 0.005

    def step(state, _):
        R, omega = state
        alpha = acceleration(pullback(Partial(turned, R), leaf), jnp.zeros(3), omega)
        omega = omega + dt * alpha
        return (turned(R, dt * omega).reshape(3, 3), omega), None

    start = jnp.asarray(random_rotations(500)), jnp.zeros((500, 3))
    R, omega = jax.jit(jax.vmap(lambda R, w: jax.lax.scan(step, (R, w), length=1600)[0]))(*start)
    angle = 2 * np.arcsin(np.clip(np.linalg.norm(R - leaf.R_world_goal, axis=(1, 2)) / np.sqrt(8), 0, 1))
    assert angle.max() < 1e-3 and np.abs(omega).max() < 1e-2


def test_certificate_on_the_panda(assert_certified):
    robot = panda()
    tree = pullback(FrameRotation(robot, "panda_hand"), goal_leaf()) + Damping(0.05, 1.0)
    rng = np.random.default_rng(0)
    assert_certified(tree, rng.uniform(robot.lower, robot.upper, (1000, 7)), rng.normal(size=(1000, 7)))


def test_the_panda_turns_its_hand():
    robot = panda()
    rng = np.random.default_rng(1)
    middle, half = (robot.lower + robot.upper) / 2, (robot.upper - robot.lower) / 2
    start, goals = middle + 0.5 * half * rng.uniform(-1, 1, (2, 20, 7))
    limits = JointLimit(jnp.asarray(robot.lower), jnp.asarray(robot.upper))

    def run(q, at_goal):
        R = forward_kinematics(robot, at_goal, "panda_hand")[:3, :3]
        tree = pullback(FrameRotation(robot, "panda_hand"), OrientationAttractor(R)) + limits + Damping(0.01, 2.0)
        R_end = forward_kinematics(robot, rollout(tree, q, duration=6.0, dt=0.005).q[-1], "panda_hand")[:3, :3]
        return jnp.linalg.norm(R_end - R) / jnp.sqrt(2.0)

    assert np.max(jax.jit(jax.vmap(run))(start, goals)) < 0.01


def test_smooth_at_the_goal_and_at_half_turns(assert_smooth, assert_single, traces_of):
    leaf = goal_leaf()
    x = np.stack([turned(leaf.R_world_goal, np.array([0, 0, t])) for t in (0.0, 1e-8, np.pi)])
    for rounding in ROUNDINGS:
        assert_smooth(goal_leaf(rounding), x, np.zeros_like(x))
        assert_smooth(goal_leaf(rounding), x, np.ones_like(x))
    assert_single(leaf, x[0], x[0])
    assert traces_of(leaf, jnp.asarray(x[0]), fixed=("R_world_goal",)) == 1


def test_bad_parameters_are_named():
    with pytest.raises(RigidTransformError, match=r"R_world_goal is no rigid transform: .* reflection"):
        OrientationAttractor(np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(RigidTransformError, match="R_world_goal is no rigid transform: its rotation part is not orth"):
        OrientationAttractor(2 * np.eye(3))
    with pytest.raises(ShapeError, match=r"R_world_goal has shape \(9,\), expected \(3, 3\)"):
        OrientationAttractor(np.eye(3).reshape(9))
    with pytest.raises(ConfigurationError, match="rounding of OrientationAttractor is 0.0, expected a positive number"):
        OrientationAttractor(np.eye(3), rounding=0.0)
    with pytest.raises(ConfigurationError, match="stiffness of OrientationAttractor is -1.0, expected a number that"):
        OrientationAttractor(np.eye(3), stiffness=-1.0)
