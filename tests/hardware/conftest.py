"""What an arm in MuJoCo is driven by, and whether it was driven well."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp.hardware import (
    MujocoArm,
    law,
    to_posture,
)
from jaxrmp.kinematics import ControlPoints
from jaxrmp.policies import reaching_policy
from jaxrmp.scenes import arm_alone

START = np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.6, 0.8])


@pytest.fixture(scope="module")
def scene():
    return arm_alone("panda")


@pytest.fixture(scope="module")
def reach(scene):
    """A hand-designed policy, compiled for the arm, and a goal that it is taken to."""
    policy = reaching_policy(scene.robot, "panda_hand_tcp", START)
    T = np.eye(4)
    point = ControlPoints(scene.robot, ("panda_hand_tcp",))
    T[:3, 3] = np.asarray(point(jnp.asarray(START)))[0] + [0.05, 0.2, -0.1]
    T[:3, :3] = np.diag([1.0, -1.0, -1.0])
    return law(policy, MujocoArm(scene, START, real_time=False), obstacles=2), T, point


@pytest.fixture(scope="module")
def homing(scene):
    return law(to_posture(scene.robot, START + 0.3), MujocoArm(scene, START, real_time=False))


def arm_at(scene, q=START):
    return MujocoArm(scene, q, real_time=False)


def within_limits(sent, arm):
    """What was sent, and not what the reference says: its velocities, and their first and second differences."""
    acceleration = np.diff(sent, axis=0, prepend=0 * sent[:1]) / arm.period
    jerk = np.diff(acceleration, axis=0, prepend=0 * sent[:1]) / arm.period
    assert (np.abs(sent) <= arm.limits.velocity).all()
    assert (np.abs(acceleration) <= arm.limits.acceleration * 1.001).all()
    assert (np.abs(jerk[:-1]) <= arm.limits.jerk * 1.001).all()  # the last ends at zero


def stands(found, arm):
    """Whether a drive that was stopped ended with the arm at rest, braked within its limits."""
    arrays = found.log.arrays()
    qd, qdd = arrays["log_velocities_told"].astype(float), arrays["log_accelerations_told"].astype(float)
    within_limits(arrays["log_command"].astype(float), arm)
    assert (np.abs(qdd) <= arm.limits.acceleration).all()
    assert arrays["log_braking"][-1] and not arrays["log_braking"][0]
    for _ in range(300):
        state = arm.read()
    return np.abs(qd[-1]).max() < 1e-3 and np.abs(state.qd).max() < 0.02
