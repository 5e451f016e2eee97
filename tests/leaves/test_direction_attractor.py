"""The direction attractor: against the geometry of the sphere, and a hand that stays upright on its way."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

import jaxrmp
from jaxrmp import ConfigurationError, ShapeError, policies, pullback
from jaxrmp.kinematics import FrameAxes, forward_kinematics, panda
from jaxrmp.leaves import DirectionAttractor
from jaxrmp.simulation import rollout
from jaxrmp.world import World

HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], np.float32)
HAND = "panda_hand_tcp"


def on_sphere(y, side, up, w):
    """Directions near y by two angles w: to second order that of the exponential map."""
    v = w[0] * side + w[1] * up
    return (y * (1 - w @ w / 4) + v) / (1 + w @ w / 4)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("rounding", [1.0, 0.05])
def test_metric_and_torque_along_great_circles(rounding):
    leaf = DirectionAttractor(np.array([0.0, 0.0, 2.0]), weight=2.0, stiffness=9.0, rounding=rounding)
    goal, side, c = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.8, 0.0]), 1 - rounding
    for angle in (0.0, 1e-6, 0.3, 1.5, 2.8, 3.1, np.pi):
        y = jnp.asarray(np.cos(angle) * goal + np.sin(angle) * side)
        away = jnp.asarray(-np.sin(angle) * goal + np.cos(angle) * side)
        chart = Partial(on_sphere, y, away, jnp.asarray(np.cross(goal, side)))
        form = pullback(chart, leaf)(jnp.zeros(2), jnp.zeros(2))
        np.testing.assert_allclose(form.M, 2.0 * np.eye(2), atol=1e-12)
        torque = 2.0 * 9.0 * np.sin(angle) / np.sqrt(1 - c * np.sin(angle / 2) ** 2)
        np.testing.assert_allclose(form.f, [-torque, 0.0], atol=1e-11)
        np.testing.assert_allclose(leaf.gap(y), angle, atol=1e-7)


def test_a_hand_stays_upright_on_its_way_and_arrives():
    robot = panda()
    goal = np.array(forward_kinematics(robot, HOME, HAND))
    goal[:3, 3] += [-0.1, 0.5, 0.1]
    goal[:3, :3] = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
    policy = policies.reaching_policy(robot, HAND, rest=HOME)
    kept = replace(policy, always=policy.always + policies.upright(robot, HAND, direction=(0, 0, -1)))
    run = jax.jit(lambda tree: rollout(tree, HOME, duration=4.0, dt=0.002).q)
    tilt = []
    for each in (policy, kept):
        tree = each.tree(goal, World())
        assert jaxrmp.uncertified_leaves(tree) == ()
        q = run(tree)
        down = jax.vmap(FrameAxes(robot, HAND, 2))(q)[:, 0, 2]
        tilt.append(float(np.degrees(np.arccos(np.clip(-down, -1, 1))).max()))
    assert tilt[0] > 2 and tilt[1] < 0.5
    assert np.linalg.norm(np.asarray(forward_kinematics(robot, q[-1], HAND))[:3, 3] - goal[:3, 3]) < 0.002


@pytest.mark.parametrize(("direction", "error"), [(np.zeros(3), ConfigurationError), (np.ones(2), ShapeError)])
def test_what_is_no_direction_is_told(direction, error):
    with pytest.raises(error, match="direction"):
        DirectionAttractor(direction)
