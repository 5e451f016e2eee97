"""Each piece on robots other than the Panda, and an arm of six joints that reaches a pose among obstacles."""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import (
    ConfigurationError,
    RobotError,
    ShapeError,
    UnsafeFileWarning,
    certificate,
    policies,
    uncertified_leaves,
)
from jaxrmp.kinematics import forward_kinematics, load_robot, load_robot_from_string, panda
from jaxrmp.leaves import CollisionAvoidance, JointLimit
from jaxrmp.policies import NOTHING
from jaxrmp.simulation import rollout
from jaxrmp.world import (
    ObstacleDistances,
    SelfDistances,
    Spheres,
    World,
    own_self_pairs,
    own_spheres,
    panda_self_pairs,
    panda_spheres,
)

SIX_AXIS = Path(__file__).parents[1] / "kinematics" / "models" / "six_axis.urdf"
WHEEL = """<robot name="wheel"><link name="base"/><link name="rim"/><joint name="axle" type="continuous">
<parent link="base"/><child link="rim"/><axis xyz="0 0 1"/></joint></robot>"""
START = np.array([0.3, -1.2, 1.4, -0.4, 0.5, 0.2], np.float32)


@pytest.fixture(scope="module")
def arm():
    return load_robot(SIX_AXIS)


@pytest.fixture(scope="module")
def spheres(arm):
    return own_spheres(arm)


def names(node):
    return [leaf.name for leaf in node.leaves()]


def test_limits_that_leave_no_range_are_named_by_joint(arm):
    empty = replace(arm, lower=np.asarray(arm.upper))
    with pytest.raises(RobotError, match=rf"leave no range: {arm.joint_names[0]} from "):
        policies.joint_limits(empty)


def test_limits_are_of_the_joints_that_have_them(arm):
    q, qd = jnp.asarray(START).at[4].set(3.09), jnp.zeros(6).at[4].set(1.0).at[5].set(6.1)
    limits, speeds = policies.joint_limits(arm), policies.velocity_limits(arm)
    with jax.enable_x64(True):
        q, qd = jnp.asarray(q, float), jnp.asarray(qd, float)
        form = limits(q, qd)
        assert form.M[4, 4] > 1e3 * form.M[0, 0] and form.M[5, 5] == 0  # the last joint turns for ever
        assert speeds(q, qd).f[5] < -100 and speeds(q, qd).f[4] == 0
        assert jax.jit(certificate)(limits + speeds + policies.damping(), q, qd).residual < 1e-8


def test_gains_and_leaves_are_taken_in_place_of_the_defaults(arm, spheres):
    assert policies.damping(weight=0.5).weight == 0.5
    assert policies.joint_limits(arm, reach=0.07).leaves()[0].reach == 0.07
    own = JointLimit(-np.ones(5), np.ones(5), name="mine")
    assert names(policies.joint_limits(arm, own)) == ["mine"]
    world = World(spheres=Spheres.of([((0.4, 0.0, 0.4), 0.1)]))
    assert names(policies.avoidance(arm, spheres, world, CollisionAvoidance(name="soft"), barrier=0.1)) == ["soft"]
    with pytest.raises(TypeError, match="brrier"):
        policies.joint_limits(arm, brrier=1.0)
    np.testing.assert_allclose(policies.posture(arm).rest[[2, 5]], [0.0, 0.0], atol=1e-12)


def test_what_a_robot_lacks_adds_nothing(arm, spheres):
    wheel = load_robot_from_string(WHEEL)
    nothing = [
        policies.joint_limits(wheel),
        policies.velocity_limits(wheel),
        policies.avoidance(arm, spheres, World()),
        policies.avoidance(arm, None, World()),
        policies.self_avoidance(arm, spheres, ()),
        policies.self_avoidance(arm, None),
    ]
    assert names(sum(nothing, NOTHING)) == []
    assert names(sum(nothing, NOTHING) + policies.damping()) == ["joint_damping"]
    with pytest.warns(UnsafeFileWarning, match="'wheel' avoids neither obstacles nor itself.*no file"):
        assert policies.reaching_policy(wheel, "rim").spheres is None


def test_the_farther_links_feel_each_other_the_more_pairs_are_kept(arm, spheres):
    near, far = (policies.self_avoidance(arm, spheres, reach=reach).task_map.pairs for reach in (0.05, 0.4))
    unknown = jax.eval_shape(lambda reach: policies.self_avoidance(arm, spheres, reach=reach), 0.05)
    assert set(near) < set(far) <= set(unknown.task_map.pairs) == set(own_self_pairs(arm, spheres))


def test_own_spheres_of_the_panda_are_the_measured_ones_and_finer_at_the_hand():
    found, measured = own_spheres(panda()), panda_spheres()
    assert found.frames == measured.frames and own_self_pairs(panda(), found) == panda_self_pairs()
    np.testing.assert_array_equal(found.offsets, measured.offsets)
    close = own_spheres(panda(), "panda_hand_tcp")
    hand = [k for k, name in enumerate(close.frames) if name in ("panda_link7", "panda_hand")]
    assert close.size > found.size and hand[0] == 0


def test_spheres_that_no_joint_moves_are_told_from_the_others(arm, spheres):
    moving = spheres.moving(arm)
    assert not {"base", "shoulder"} & set(moving.frames) and {"upper_arm", "wrist_3"} <= set(moving.frames)
    q = np.random.default_rng(0).uniform(-2, 2, (4, 6))
    travel = np.ptp(jax.jit(jax.vmap(spheres.points(arm)))(jnp.asarray(q, jnp.float32)), axis=0).max(-1)
    assert (travel > 1e-4).sum() == moving.size


def test_an_arm_of_six_joints_reaches_a_pose_among_obstacles(arm, spheres):
    start = jnp.asarray(START)
    goal = np.asarray(forward_kinematics(arm, start + jnp.array([0.8, 0.2, -0.2, 0.3, -0.3, 0.5]), "tool"))
    between = np.asarray(forward_kinematics(arm, start + jnp.array([0.4, 0.1, -0.1, 0.1, -0.1, 0.2]), "tool"))[:3, 3]
    world = World(spheres=Spheres.of([(between, 0.04)], capacity=2))
    policy = policies.reaching_policy(arm, "tool", START, spheres)
    tree = policy.tree(goal, world)
    assert uncertified_leaves(tree) == ()
    path = jax.jit(lambda tree: rollout(tree, start, duration=6.0, dt=0.001, warn=False))(tree)
    end = np.asarray(forward_kinematics(arm, path.q[-1], "tool"))
    assert np.linalg.norm(end[:3, 3] - goal[:3, 3]) < 0.01
    assert np.arccos((np.trace(end[:3, :3].T @ goal[:3, :3]) - 1) / 2) < 0.1  # rad: the posture has a say in the turn
    assert np.diff(path.energy).max() < 1e-3 * np.ptp(path.energy)
    away = ObstacleDistances(policy.spheres.points(arm), world, policy.spheres.radii)
    own = SelfDistances(spheres.points(arm), own_self_pairs(arm, spheres), spheres.radii)
    least = jax.jit(jax.vmap(lambda q: (away(q).min(), own(q).min())))(path.q[::50])
    assert min(np.min(d) for d in least) > 0
    assert (np.abs(path.qd) < arm.velocity_limit).all()
    free = replace(policy, spheres=None).tree(goal, world)
    straight = jax.jit(lambda tree: rollout(tree, start, duration=3.0, dt=0.001, warn=False))(free)
    assert np.min(jax.jit(jax.vmap(lambda q: away(q).min()))(straight.q[::20])) < 0  # the obstacle was in the way


def test_a_rest_or_a_target_of_another_shape_is_told():
    with pytest.raises(ShapeError, match="rest"):
        policies.posture(panda(), np.zeros(5))
    with pytest.raises(ShapeError, match="T_world_target"):
        policies.reaching_policy(panda(), "panda_hand_tcp").tree(np.zeros(3), World())


def test_a_rest_that_cannot_be_had_names_the_joint():
    for position, said in ((np.nan, "nan"), (3.0, "3")):
        rest = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
        rest[1] = position
        for build in (policies.posture, lambda arm, rest: policies.reaching_policy(arm, "panda_hand_tcp", rest)):
            with pytest.raises(ConfigurationError, match=rf"panda_joint2 {said} \(from -1.7628 to 1.7628\)"):
                build(panda(), rest)


def test_a_rest_in_which_links_touch_names_them():
    folded = np.array([0.0, 0.0, 0.0, -3.0, 0.0, 0.0, 0.0])
    with pytest.raises(ConfigurationError, match=r"spheres on panda_\w+ and panda_\w+ overlap by .* cm .*find_rest"):
        policies.reaching_policy(panda(), "panda_hand_tcp", rest=folded)
    assert policies.reaching_policy(panda(), "panda_hand_tcp", rest=folded, self_collision=False).spheres is not None
    half = np.array([2.8, 1.7, 2.8, 1.5, 2.8, 1.8, 2.8])
    turned = replace(panda(), lower=folded - half, upper=folded + half)
    with pytest.warns(UnsafeFileWarning, match=r"in the middle of the joints, .*panda_\w+ overlap by .*find_rest"):
        policies.reaching_policy(turned, "panda_hand_tcp")
