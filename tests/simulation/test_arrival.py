"""Rollouts that do not end at their goals say so."""

import warnings
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import Affine, Batched, Distance, batched, compose, pullback
from jaxrmp.inspection import goals, inspect
from jaxrmp.leaves import Attractor, CollisionAvoidance, Damping, Formation, JointLimit, OrientationAttractor, Posture
from jaxrmp.leaves.lula import AxisTarget, CSpaceTarget, PositionTarget
from jaxrmp.simulation import GoalWarning, StiffnessWarning, arrival, rollout, warn_if_stiff


@pytest.fixture(autouse=True)
def x64():
    with jax.enable_x64(True):
        yield


LIMITS = JointLimit(-jnp.ones(2), jnp.ones(2))


def reach(goal):
    """A point inside a box of joint limits that is drawn to `goal`."""
    pull = Attractor(jnp.asarray(goal), sharpness=5.0, gain=3.0, damping_rate=4.0)
    return pull + LIMITS + Damping(1e-3, 4.0)


@partial(jax.jit, static_argnums=1)
def run(tree, duration=20.0):
    return rollout(tree, jnp.zeros(2), duration=duration, dt=0.01)


@pytest.fixture(scope="module")
def out_of_reach():
    with jax.enable_x64(True):
        return run(reach([1.5, 0.2]))


def test_a_goal_within_reach_is_reached():
    found = arrival(run(reach([0.5, 0.2])))
    assert found.goals == ("attractor",) and found.reached.all() and found.at_rest and not found.out_of_reach.any()
    np.testing.assert_allclose(found.gap, 0, atol=1e-3)


def test_a_goal_beyond_the_limits_is_reported_with_what_is_left(out_of_reach):
    found = arrival(out_of_reach)
    assert found.at_rest and found.out_of_reach.tolist() == [True]
    np.testing.assert_allclose(found.gap, np.linalg.norm(out_of_reach.q[-1] - np.array([1.5, 0.2])))
    assert 0.5 < found.gap[0] < 0.6 and out_of_reach.q[-1, 0] < 1
    np.testing.assert_allclose(out_of_reach.gap[0], [np.hypot(1.5, 0.2)])
    assert arrival(out_of_reach, tolerance=0.7).reached.all()


def test_an_arm_on_its_way_is_not_out_of_reach():
    found = arrival(run(reach([0.5, 0.2]), 0.3))
    assert not found.at_rest and not found.reached.any() and not found.out_of_reach.any()
    first_step = rollout(reach([0.5, 0.2]), jnp.zeros(2), duration=1e-3, dt=1e-3, warn=False)
    assert np.abs(first_step.qd).max() < 0.01 and not arrival(first_step).at_rest  # slow still, but not for long


def test_states_that_are_no_numbers_are_not_at_rest(out_of_reach):
    found = arrival(jax.tree.map(lambda a: a * jnp.nan, out_of_reach))
    assert not found.at_rest and not found.reached.any()


def test_a_call_with_numbers_warns_and_a_traced_one_reports():
    lost, found = reach([1.5, 0.2]), reach([0.5, 0.2])
    with pytest.warns(
        GoalWarning, match=r"came to rest away from its goals: 0\.5\d+ from that of 'attractor'"
    ) as caught:
        rollout(lost, jnp.zeros(2), duration=20.0, dt=0.01)
    assert [w.filename for w in caught if w.category is GoalWarning] == [__file__]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rollout(found, jnp.zeros(2), duration=20.0, dt=0.01)
        rollout(lost, jnp.zeros(2), duration=20.0, dt=0.01, warn=False)
        batch = jax.jit(jax.vmap(lambda goal: arrival(rollout(reach(goal), jnp.zeros(2), duration=20.0, dt=0.01))))(
            jnp.array([[1.5, 0.2], [0.5, 0.2]])
        )
    assert batch.out_of_reach.tolist() == [[True], [False]] and batch.goals == ("attractor",)


def test_the_gap_at_the_end_has_a_gradient():
    def left(goal):
        return rollout(Attractor(goal) + Damping(), jnp.zeros(2), duration=0.5, dt=0.05).gap[-1, 0]

    goal, h = jnp.array([0.5, 0.2]), 1e-6
    slope = jax.jit(jax.grad(left))(goal)
    compiled = jax.jit(left)
    numeric = [(compiled(goal + h * e) - compiled(goal - h * e)) / (2 * h) for e in np.eye(2)]
    np.testing.assert_allclose(slope, numeric, rtol=1e-6)


def test_a_step_too_long_anywhere_on_the_way_is_warned_of():
    to_wall = Affine(jnp.array([[-1.0]]), jnp.array([1.0]))
    wall = pullback(to_wall, CollisionAvoidance(damping_rate=0.5, reach=0.5, barrier=1.0))
    tree = wall + Attractor(jnp.array([2.0]), gain=500.0, weight_near=1.0, damping_rate=2.0) + Damping(0.01, 1.0)
    start, dt = jnp.zeros(1), 0.02
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_if_stiff(tree, start, start, dt)
    with pytest.warns(StiffnessWarning, match=r"may ring|is unstable") as caught:
        rollout(tree, start, duration=10.0, dt=dt)
    assert [w.filename for w in caught if w.category is StiffnessWarning] == [__file__]


def test_goals_are_the_inspectors_gaps_of_the_leaves_that_have_one():
    R = jnp.eye(3)
    points = compose(Affine(jnp.eye(6), jnp.arange(6.0)), jax.tree_util.Partial(lambda x: x.reshape(2, 3)))
    tree = (
        pullback(points, batched(Attractor(jnp.ones(3)), Attractor(-jnp.ones(3))))
        + pullback(points, Batched(pullback(Distance(jnp.zeros(3), 0.1), Formation()) + Damping(), shared=True))
        + pullback(Affine(jnp.ones((9, 6)) / 9, R.reshape(9)), OrientationAttractor(R))
        + pullback(Affine(jnp.ones((6, 6)), jnp.zeros(6)), AxisTarget(jnp.array([0.0, 0, 1]), jnp.zeros(3)))
        + pullback(Affine(jnp.ones((3, 6)), jnp.zeros(3)), PositionTarget(jnp.ones(3)))
        + Posture(jnp.ones(6))
        + CSpaceTarget(jnp.ones(6))
    )
    q = jnp.asarray(np.random.default_rng(0).uniform(-0.3, 0.3, 6))
    left, everything = jax.jit(lambda q: (goals(tree, q), inspect(tree, q, jnp.zeros(6))))(q)
    assert left.names == (
        *("attractor[0]", "attractor[1]", "formation[0]", "formation[1]"),
        *("orientation_attractor", "axis_target", "position_target"),
    )
    expected = [everything.gap[everything.names.index(name)] for name in left.names]
    np.testing.assert_allclose(left.gap, expected, rtol=1e-12)
    np.testing.assert_allclose(left.gap[0], np.linalg.norm(np.arange(3) + q[:3] - 1))
    np.testing.assert_allclose(left.gap[5], np.linalg.norm(q.sum() - np.array([0.0, 0, 1])))
    assert goals(Posture(jnp.ones(6)), q).gap.shape == (0,)


@pytest.mark.parametrize("angle", [0.0, 1e-5, 0.4, 3.0, np.pi])
def test_the_gap_of_an_orientation_is_its_angle(angle):
    leaf = OrientationAttractor(jnp.eye(3))
    c, s = np.cos(angle), np.sin(angle)
    y = jnp.array([c, -s, 0, s, c, 0, 0, 0, 1])
    np.testing.assert_allclose(leaf.gap(y), angle, atol=1e-7)
    assert np.isfinite(jax.grad(leaf.gap)(y)).all()
