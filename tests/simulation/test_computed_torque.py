"""From accelerations to torques, against MuJoCo's own dynamics."""

import jax.numpy as jnp
import mujoco
import numpy as np

from jaxrmp import scenes, simulation

HOME = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])


def test_the_arm_accelerates_as_asked():
    scene = scenes.scene("drawer")
    data = scene.data(HOME)
    m, dofs = scene.model, scene.arm_dofs
    limit = m.actuator_ctrlrange[scene.arm_actuators, 1]
    data.qvel[dofs] = np.linspace(-0.3, 0.3, 7)
    for k in range(200):
        mujoco.mj_step1(m, data)
        qdd = np.sin(0.02 * k + np.arange(7))
        torque, saturated = simulation.computed_torque(simulation.arm_dynamics(m, data, dofs), qdd, limit)
        assert not saturated.any()
        data.ctrl[scene.arm_actuators] = torque
        before = data.qvel[dofs].copy()
        mujoco.mj_step2(m, data)
        # the integrator takes joint damping implicitly, which costs a hundredth
        np.testing.assert_allclose((data.qvel[dofs] - before) / m.opt.timestep, qdd, atol=0.02)


def test_limits_cut_and_are_reported_in_numpy_and_in_jax():
    for xp in (np, jnp):
        dynamics = simulation.ArmDynamics(xp.eye(3), xp.array([0.0, 5.0, 0.0]))
        torque, saturated = simulation.computed_torque(dynamics, xp.array([1.0, 6.0, -20.0]), xp.full(3, 10.0))
        np.testing.assert_array_equal(torque, [1.0, 10.0, -10.0])
        np.testing.assert_array_equal(saturated, [False, True, True])


def test_velocity_limits_brake_what_is_beyond_them():
    allowed = simulation.within_velocity_limits(
        np.array([100.0, 100.0, -1.0]), np.array([0.0, 2.0, 2.2]), np.full(3, 2.0), horizon=0.01
    )
    np.testing.assert_allclose(allowed, [100.0, 0.0, -20.0])
