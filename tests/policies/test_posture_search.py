"""Postures for goals: found within limits, clear, and told where there is none; drawn to them, arms get around."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, ShapeError, UnsafeFileWarning, uncertified_leaves
from jaxrmp.kinematics import forward_kinematics, load_robot_from_string, panda
from jaxrmp.policies import find_posture, guided, reaching_policy
from jaxrmp.simulation import rollout
from jaxrmp.world import Spheres, World, own_spheres

HAND = "panda_hand_tcp"
SHOULDER = """<mujoco model="planar"><compiler angle="radian" autolimits="true"/><worldbody><body name="upper">
<joint name="shoulder" axis="0 0 1" range="-3 3"/><geom type="capsule" size=".03" fromto=".05 0 0 .25 0 0"/>
<body name="fore" pos=".3 0 0"><joint name="elbow" axis="0 0 1" range="-2 2"/>
<geom type="capsule" size=".03" fromto=".05 0 0 .25 0 0"/><body name="hand" pos=".3 0 0">
<joint name="wrist" axis="0 0 1" range="-2 2"/></body></body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def arm():
    return panda()


@pytest.fixture(scope="module")
def asked(arm):
    """Poses of the hand at random postures, [6, 4, 4]."""
    rng = np.random.default_rng(3)
    low, high = np.asarray(arm.lower), np.asarray(arm.upper)
    q = rng.uniform(low + 0.1 * (high - low), high - 0.1 * (high - low), (6, 7)).astype(np.float32)
    return jax.vmap(lambda q: forward_kinematics(arm, q, HAND))(jnp.asarray(q))


def test_what_is_found_is_at_the_goal_within_limits_and_clear(arm, asked):
    spheres, hit = own_spheres(arm), asked[:, :3, 3].mean(0)
    world = World(spheres=Spheres.of([(hit, 0.05)]))
    found = jax.jit(jax.vmap(lambda T: find_posture(arm, HAND, T, None, spheres, world)))(asked)
    at = jax.vmap(lambda q: forward_kinematics(arm, q, HAND))(found.q)
    np.testing.assert_allclose(at, asked, atol=2e-3)
    assert found.position_error.max() < 1e-3 and found.turn_error.max() < 5e-3
    assert (found.q > np.asarray(arm.lower)).all() and (found.q < np.asarray(arm.upper)).all()
    assert found.clearance.min() > 0


def test_a_goal_out_of_reach_or_of_no_numbers_is_told_by_its_error(arm, asked):
    far = asked[0].at[:3, 3].set(jnp.array([1.5, 0.0, 0.4]))
    find = jax.jit(lambda T: find_posture(arm, HAND, T))
    found = find(far)
    assert found.position_error > 0.3 and jnp.isinf(found.clearance)
    lost = find(far.at[0, 3].set(jnp.nan))
    assert jnp.isfinite(lost.q).all() and jnp.isnan(lost.position_error)


def test_an_arm_that_is_drawn_to_its_posture_goes_round_a_joint_limit_that_stops_the_hand():
    """From 140 degrees to -140: the hand's short way is past the shoulder's limit, the way round is 280 degrees."""
    robot = load_robot_from_string(SHOULDER)
    start, end = np.array([2.44, 0.2, 0.2], np.float32), np.array([-2.44, -0.2, -0.2], np.float32)
    T = np.asarray(forward_kinematics(robot, end, "hand"))
    with pytest.warns(UnsafeFileWarning, match="no file"):
        policy = reaching_policy(robot, "hand", start)
    drawn = guided(policy, find_posture(robot, "hand", jnp.asarray(T), start).q)
    roll = jax.jit(lambda tree: rollout(tree, jnp.asarray(start), duration=8.0, dt=0.002, warn=False))
    assert uncertified_leaves(drawn.tree(T, World())) == ()
    stuck, there = (
        np.linalg.norm(np.asarray(forward_kinematics(robot, roll(p.tree(T, World())).q[-1], "hand"))[:3, 3] - T[:3, 3])
        for p in (policy, drawn)
    )
    assert stuck > 0.1 and there < 2e-3


def test_an_arm_of_few_joints_is_asked_for_positions_and_two_hands_for_a_pose_each(arm, asked):
    found = jax.jit(lambda T: find_posture(arm, HAND, T, turned=False, starts=16))(asked[1])
    assert found.position_error < 1e-3 and found.turn_error == 0
    frames = (HAND, "panda_link4")
    q = jnp.array([0.3, -0.4, 0.2, -2.0, 0.1, 1.8, 0.5], jnp.float32)
    both = jnp.stack([forward_kinematics(arm, q, frame) for frame in frames])
    assert jax.jit(lambda T: find_posture(arm, frames, T))(both).position_error < 1e-3
    with pytest.raises(ShapeError, match="each of 2 hands"):
        find_posture(arm, frames, asked[0])
    with pytest.raises(ConfigurationError, match="starts is 0"):
        find_posture(arm, HAND, asked[0], starts=0)
    with pytest.raises(ShapeError, match=r"\(3, 4\)"):
        find_posture(arm, HAND, asked[0, :3])
    with pytest.raises(ShapeError, match=r"expected \(7,\)"):
        guided(reaching_policy(arm, HAND), np.zeros(3))
