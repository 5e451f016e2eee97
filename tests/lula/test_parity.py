"""The published test vector of NVIDIA's RMPflow for the Franka."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks._policies import world_of
from jaxrmp import ConfigurationError, ShapeError, UnknownNameError, uncertified_leaves
from jaxrmp.io import load_lula
from jaxrmp.kinematics import ControlPoints, forward_kinematics
from jaxrmp.world import Spheres, World, ignored_in


def golden_tree(policy, golden):
    return policy.tree(
        frame=golden["frame"],
        position_target=golden["position_target"],
        cspace_target=golden["cspace_attractor"],
        world=world_of(golden, free=1),
    )


def state_of(golden):
    return jnp.array(golden["q"]) * 1.0, jnp.array(golden["qd"]) * 1.0


def test_root_and_acceleration_are_the_published_ones(policy, golden):
    with jax.enable_x64(True):
        q, qd = state_of(golden)
        tree = golden_tree(policy, golden)
        form, qdd = jax.jit(lambda policy, tree: (tree(q, qd), policy.acceleration(tree, q, qd)))(policy, tree)
        M, f, qdd = (np.asarray(value) for value in (form.M, form.f, qdd))
    force, metric = np.array(golden["expected_force"]), np.array(golden["expected_metric"])
    assert np.abs(M - metric).max() <= 2e-5
    assert (np.abs(f - force) / np.abs(force)).max() <= 1e-6
    assert np.abs(qdd - np.array(golden["expected_accel"])).max() <= 1e-3


def test_a_tree_of_theirs_has_no_certificate_and_says_which_leaves_void_it(policy, golden):
    names = uncertified_leaves(golden_tree(policy, golden))
    assert set(names) == {
        *("cspace_target", "cspace_inertia", "joint_limit", "joint_velocity_cap"),
        *("position_target", "damping", "damping_inertia", "collision", "self_collision"),
    }


def test_single_precision_gives_the_same_and_changes_of_numbers_do_not_retrace(policy, golden):
    traces = []

    @jax.jit
    def step(policy, target, posture, world, q, qd):
        traces.append(1)
        tree = policy.tree(frame=golden["frame"], position_target=target, cspace_target=posture, world=world)
        return policy.acceleration(tree, q, qd)

    q, qd = state_of(golden)
    world, target = world_of(golden, free=1), jnp.array(golden["position_target"])
    posture = jnp.array(golden["cspace_attractor"], jnp.float32)
    first = step(policy, target, posture, world, q, qd)
    assert q.dtype == first.dtype == jnp.float32
    assert np.abs(first - np.array(golden["expected_accel"])).max() <= 2e-2
    moved = dataclasses.replace(world, spheres=world.spheres.set(1, center=(0.5, 0.3, 0.4), radius=0.1))
    stiffer = dataclasses.replace(
        policy, position_target=dataclasses.replace(policy.position_target, accel_p_gain=60.0)
    )
    second = step(stiffer, target + 0.1, posture, moved, q, qd + 0.1)
    assert len(traces) == 1
    assert np.isfinite(second).all() and np.abs(first - second).max() > 0.1


def test_the_arm_reaches_position_and_axes(policy, golden):
    q = jnp.array(golden["q"])
    reachable = forward_kinematics(policy.robot, q + jnp.array([0.3, 0.4, -0.2, 0.6, 0.2, 0.3, -0.4]), "right_gripper")
    tree = policy.tree(
        frame="right_gripper",
        position_target=reachable[:3, 3],
        x_axis_target=reachable[:3, 0],
        y_axis_target=reachable[:3, 1],
        z_axis_target=reachable[:3, 2],
    )

    def step(state, _):
        q, qd = state
        qd = qd + 0.01 * policy.acceleration(tree, q, qd)
        return (q + 0.01 * qd, qd), None

    (q, _), _ = jax.jit(lambda state: jax.lax.scan(step, state, length=1500))((q, jnp.zeros_like(q)))
    assert np.abs(forward_kinematics(policy.robot, q, "right_gripper") - reachable).max() < 0.01


def test_self_collision_keeps_the_hand_off_the_base(policy):
    with jax.enable_x64(True):
        q = jnp.array([0.0, -1.7, 0.0, -3.0, 0.0, 1.0, 0.0])
        at = ControlPoints(policy.robot, policy.controllers.frames)(q)
        from_axis = np.linalg.norm(np.asarray(at)[:, :2], axis=1)
        between = (np.asarray(at)[:, 2] < 0.333) & (np.asarray(at)[:, 2] > -0.3)
        expected = from_axis - 0.02 - policy.controllers.radii
        found = np.asarray(policy.base.signed_distance(at))[:, 0] - policy.controllers.radii
        assert between.any()
        np.testing.assert_allclose(found[between], expected[between], atol=1e-12)


def test_axis_targets_without_a_position_target_turn_only(policy, golden):
    q, qd = state_of(golden)
    tree = policy.tree(frame="right_gripper", z_axis_target=jnp.array([0.0, 0.0, -1.0]))
    assert "position_target" not in uncertified_leaves(tree) and "axis_target" in uncertified_leaves(tree)
    form = jax.jit(lambda tree: tree(q, qd))(tree)
    assert np.isfinite(form.f).all() and np.isfinite(form.M).all()


def test_points_act_as_the_spheres_of_their_margin(folder, golden):
    policy = load_lula(folder / "franka.urdf", folder / "franka.xrdf", folder / "franka_rmpflow_config.yaml")
    assert policy.inactive == ("cspace_trajectory_rmp", "cspace_affine_rmp")
    assert policy.max_num_points == 100_000
    q, qd = state_of(golden)
    near, far = np.array([[0.35, 0.0, 0.55]]), np.array([[50.0, 0.0, 0.0]])
    with_points = policy.tree(point_cloud=np.concatenate([near, far])).nodes
    unseen = jax.jit(
        lambda cloud: (lambda tree: (tree.nodes[-1](q, qd), ignored_in(tree)))(policy.tree(point_cloud=cloud))
    )(jnp.concatenate([near, jnp.full((2, 3), jnp.nan), jnp.full((1, 3), jnp.inf)]))
    assert unseen[1] == 3
    as_sphere = dataclasses.replace(policy, collision=policy.point_cloud_collision)
    world = World(spheres=Spheres.of([(near[0], policy.point_cloud_margin)]))
    with_sphere = as_sphere.tree(world=world).nodes
    assert len(with_points) == len(with_sphere) == len(policy.tree().nodes) + 1
    of_points, of_sphere = jax.jit(lambda nodes: [node(q, qd) for node in nodes])([with_points[-1], with_sphere[-1]])
    assert np.abs(of_points.f).max() > 1e-4 and np.abs(of_points.M).max() > 0.1
    for a, b, c in zip(*map(jax.tree.leaves, (of_points, of_sphere, unseen[0])), strict=True):
        np.testing.assert_allclose(c, b, rtol=1e-4, atol=1e-6 * np.abs(b).max())
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6 * np.abs(b).max())


def test_what_a_tree_cannot_be_made_of_is_refused(policy):
    with pytest.raises(UnknownNameError, match="Did you mean 'right_gripper'"):
        policy.tree(frame="right_griper", position_target=np.zeros(3))
    with pytest.raises(ShapeError, match=r"position_target has shape \(2,\), expected \(3,\)"):
        policy.tree(position_target=np.zeros(2))
    with pytest.raises(ShapeError, match=r"cspace_target has shape \(6,\), expected \(7,\)"):
        policy.tree(cspace_target=np.zeros(6))
    with pytest.raises(ConfigurationError, match="x_axis_target must be a unit vector"):
        policy.tree(x_axis_target=np.array([1.0, 1.0, 0.0]))
    with pytest.raises(ConfigurationError, match="no point_cloud_obstacle_rmp"):
        policy.tree(point_cloud=np.zeros((1, 3)))
