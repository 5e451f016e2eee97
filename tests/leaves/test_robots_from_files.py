"""Whole certified trees on robots read from files: a six-axis arm, and two arms on one column."""

from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxrmp import Distance, Pointwise, Selection, batched, compose, pullback
from jaxrmp.kinematics import ControlPoints, PointsInFrame, RelativePoints, frame_poses, load_robot
from jaxrmp.leaves import (
    Attractor,
    CollisionAvoidance,
    Damping,
    Formation,
    JointLimit,
)
from jaxrmp.world import (
    Boxes,
    ObstacleDistances,
    RobotSpheres,
    SelfDistances,
    Spheres,
    World,
    self_pairs,
    spheres_from_model,
)

pytestmark = pytest.mark.usefixtures("x64")
MODELS = Path(__file__).parent.parent / "kinematics" / "models"
WORLD = World(
    spheres=Spheres.of([((0.5, 0.2, 0.4), 0.1), ((-0.3, 0.5, 0.7), 0.15)], capacity=3),
    boxes=Boxes.of([(np.eye(4), (0.1, 0.2, 0.05))]),
)
AVOID = CollisionAvoidance(barrier=1e-3, reach=0.4, damping_rate=1.0)


def limits_of(robot):
    """Joint limits for those joints that have them."""
    limited = np.flatnonzero(np.isfinite(robot.lower) & np.isfinite(robot.upper))
    leaf = JointLimit(robot.lower[limited], robot.upper[limited], weight=0.5, sigma=0.3)
    return leaf if len(limited) == robot.num_joints else pullback(Selection(limited), leaf)


def states_of(robot, count=1000):
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(robot.lower, -3), np.minimum(robot.upper, 3), (count, robot.num_joints))
    return q, rng.normal(size=q.shape)


def test_a_six_axis_arm_from_urdf(assert_certified):
    path = MODELS / "six_axis.urdf"
    robot = load_robot(path)
    assert robot.joint_names == ("pan", "lift", "elbow", "bend", "swing", "roll")
    np.testing.assert_allclose(robot.velocity_limit, [3.1, 3.1, 3.1, 6.2, 6.2, 6.2])
    assert np.isinf([robot.lower[5], robot.upper[5]]).all() and np.isfinite(robot.upper[:5]).all()

    q, qd = states_of(robot)
    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.fusestatic = False
    m = spec.compile()
    d = mujoco.MjData(m)
    ours = jax.jit(jax.vmap(lambda q: frame_poses(robot, q, ("forearm", "tool"))))(q[:20])
    for configuration, poses in zip(q, ours, strict=False):
        d.qpos[:] = configuration
        mujoco.mj_kinematics(m, d)
        for name, T in zip(("forearm", "tool"), poses, strict=True):
            np.testing.assert_allclose(T[:3, 3], d.body(name).xpos, atol=1e-12)
            np.testing.assert_allclose(T[:3, :3], d.body(name).xmat.reshape(3, 3), atol=1e-12)

    spheres = spheres_from_model(path, 0.05)
    tree = (
        pullback(ControlPoints(robot, ("tool",)), batched(Attractor(np.array([0.4, 0.2, 0.5]))))
        + pullback(ObstacleDistances(spheres.points(robot), WORLD, spheres.radii), AVOID)
        + limits_of(robot)
        + Damping(0.1, 1.0)
    )
    assert_certified(tree, q, qd)


def test_two_arms_on_a_column_from_mjcf(assert_certified):
    robot = load_robot(MODELS / "branching.xml")
    assert robot.num_joints == 7 and np.isinf(robot.velocity_limit).all()  # MJCF knows no velocity limits
    frames = ("left_upper", "left_lower", "left_tool", "right_upper", "right_slider", "right_tool")
    spheres = RobotSpheres(frames, np.zeros((6, 3)), np.full(6, 0.05))
    points = spheres.points(robot)
    left, right = (ControlPoints(robot, (name,)) for name in ("left_tool", "right_tool"))
    pairs = self_pairs(robot, frames)
    assert any({frames[i], frames[j]} == {"left_tool", "right_tool"} for i, j in pairs)
    apart = compose(RelativePoints(left, right), Pointwise(Distance(jnp.zeros(3), 0.4)))
    tree = (
        pullback(left, batched(Attractor(np.array([0.3, 0.3, 0.8]))))
        + pullback(
            PointsInFrame(robot, "left_tool", right), batched(Attractor(np.array([0.0, 0.2, 0.1]), sharpness=9.0))
        )
        + pullback(apart, batched(Formation(jnp.asarray(1.0), gain=4.0)))
        + pullback(ObstacleDistances(points, WORLD, spheres.radii), AVOID)
        + pullback(SelfDistances(points, pairs, spheres.radii), AVOID)
        + limits_of(robot)
        + Damping(0.1, 1.0)
    )
    assert_certified(tree, *states_of(robot))
