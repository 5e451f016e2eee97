"""The pipeline's own checks: joints, frames, objects, widths, rollouts."""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import BasinError, ConvexProgramError, DemonstrationError, RolloutError, UnknownNameError
from jaxrmp.kinematics import load_robot_from_string, panda
from jaxrmp.learning import (
    Demonstration,
    DemonstrationSet,
    choose_potential,
    learn,
    learning_report,
    load_configuration,
    prepare,
    reproduce,
    subtask_trajectories,
    training_samples,
)
from jaxrmp.learning._prepare import still_pose
from jaxrmp.synthetic import synthetic_demonstrations

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(scope="module")
def configuration():
    fast = {"method": "paper", "metric.updates": 100, "potential.widths": [0.05], "potential.basin_starts": 100}
    return load_configuration(CONFIGS / "door_reaching.toml", fast)


@pytest.fixture(scope="module")
def door():
    return synthetic_demonstrations("door_reaching", count=3)


@pytest.fixture
def learning(door_learning):
    return door_learning


def test_a_skill_ends_where_the_demonstrations_end_in_the_objects_frame(learning, configuration, door):
    ends = learning.prepared.subtasks.ends
    np.testing.assert_allclose(learning.skill.targets, ends.mean(0), atol=5e-3)
    assert learning.prepared.frame == "object door_handle"
    reproduction = reproduce(learning.skill, panda(), learning.prepared, own_targets=False)
    last = reproduction.points[:, -1]
    np.testing.assert_allclose(last, np.broadcast_to(learning.skill.targets, last.shape), atol=5e-3)
    report = learning_report(learning)
    assert report["frame"] == "object door_handle"
    assert [s["nominal_demonstration"] for s in report["subtasks"]] == list(learning.paper.nominal)


def test_too_large_steps_are_reported_and_not_returned(learning):
    wild = learning.skill.with_gains(1e30, 4000.0)  # the joint limits alone would hold anything less
    with pytest.raises(RolloutError, match="became non-finite. Lower dt or the gains"):
        reproduce(wild, panda(), learning.prepared, duration=2.0)


def test_recordings_in_degrees_are_recognised(configuration, door):
    degrees = replace(door, demonstrations=tuple(replace(d, q=np.rad2deg(d.q)) for d in door))
    with pytest.raises(DemonstrationError, match=r"joint 'panda_joint\d' is .* outside its limits .* in degrees"):
        prepare(configuration, panda(), degrees)


def test_joints_may_come_in_another_order_and_must_have_the_robots_names(configuration, door):
    order = [3, 0, 6, 1, 5, 2, 4]
    shuffled = DemonstrationSet(
        tuple(replace(d, q=d.q[:, order]) for d in door), [door.joint_names[i] for i in order], "panda"
    )
    same = prepare(configuration, panda(), shuffled)
    np.testing.assert_array_equal(same.points[0], prepare(configuration, panda(), door).points[0])
    renamed = replace(door, joint_names=tuple(f"iiwa_{i}" for i in range(7)))
    with pytest.raises(DemonstrationError, match="have joints .*iiwa_0.* robot 'panda' has .*panda_joint1"):
        prepare(configuration, panda(), renamed)


def test_a_skill_says_so_that_was_learned_without_its_object(configuration, door):
    fast = replace(configuration.potential, widths=(0.05,), basin_starts=20)
    quick = replace(configuration, method="paper", potential=fast, metric=replace(configuration.metric, updates=2))
    blind = replace(door, demonstrations=tuple(replace(d, poses={}) for d in door.demonstrations))
    tolerant = replace(quick, target=replace(quick.target, end_tolerance=0.5))
    skill = learn(tolerant, panda(), blind).skill
    assert skill.configuration.object == "" and configuration.object == "door_handle"


def test_an_object_that_is_not_there_is_named_and_one_that_moves_is_refused(configuration, door):
    with pytest.raises(UnknownNameError, match="unknown object 'door_handel'. Did you mean 'door_handle'"):
        prepare(replace(configuration, object="door_handel"), panda(), door)
    poses = np.tile(np.eye(4), (50, 1, 1))
    poses[:, 0, 3] = np.linspace(0.0, 0.3, 50)
    moving = Demonstration(np.linspace(0, 1, 50), np.zeros((50, 7)), {"cup": poses})
    np.testing.assert_array_equal(still_pose(moving, "cup", 0.31), np.eye(4))
    with pytest.raises(DemonstrationError, match="'cup' moves by 30.0 cm during demonstration 2, allowed 10.0 cm"):
        still_pose(moving, "cup", 0.1, 2)


BASE = "<mujoco><compiler angle='radian'/><worldbody>{}</worldbody></mujoco>"
ARM = """<body name="base" pos="{pos}" euler="0 0 {yaw}"><geom size=".1"/>
<body name="upper"><joint name="a" axis="0 0 1" range="-3 3" limited="true"/><geom size=".1"/>
<body name="lower" pos=".5 0 0"><joint name="b" axis="0 1 0" range="-3 3" limited="true"/><geom size=".1"/>
</body></body></body>"""


def test_object_poses_are_understood_in_the_base_frame_wherever_the_base_stands(configuration):
    time = np.linspace(0, 3, 90)
    q = np.stack([np.sin(time), 0.5 * time], axis=1)
    T = np.eye(4)
    T[:3, 3] = [0.4, 0.6, 0.1]
    demonstrations = DemonstrationSet(
        (Demonstration(time, q, {"cup": T}), Demonstration(time, 1.02 * q, {"cup": T})), ("a", "b")
    )
    subtask = replace(configuration.subtasks[0], frame="lower", offset=(0.3, 0.0, 0.0))
    configuration = replace(configuration, subtasks=(subtask,), object="cup", base="base")
    points = [
        prepare(configuration, load_robot_from_string(BASE.format(ARM.format(pos=pos, yaw=yaw))), demonstrations).points
        for pos, yaw in (("0 0 0", 0.0), ("1 0 .8", 1.5))
    ]
    np.testing.assert_allclose(points[0], points[1], atol=1e-12)


def test_training_samples_lie_in_a_tube_around_the_demonstrations(configuration, learning):
    subtasks = learning.prepared.subtasks
    x, v = training_samples(subtasks, configuration.metric, seed=0)
    N, T = subtasks.positions.shape[1:3]
    assert x.shape == v.shape == (3, N * T, 3)
    x, v = x.reshape(3, N, 2, T // 2, 3), v.reshape(3, N, 2, T // 2, 3)
    np.testing.assert_array_equal(x[:, :, 0], subtasks.positions[:, :, 1::2])
    np.testing.assert_array_equal(v[:, :, 0], subtasks.velocities[:, :, 1::2])
    aside = x[:, :, 1] - x[:, :, 0]
    # As fast as the sample itself, towards where the demonstration is `convergence` further on.
    lengths = np.linalg.norm(v, axis=-1)
    np.testing.assert_allclose(lengths[:, :, 1], lengths[:, :, 0], atol=1e-12)
    ahead = configuration.metric.convergence * subtasks.directions[:, :, 1::2] - aside
    cosine = np.sum(ahead * v[:, :, 1], -1) / np.linalg.norm(ahead, axis=-1) / np.maximum(lengths[:, :, 1], 1e-9)
    np.testing.assert_allclose(cosine[lengths[:, :, 1] > 1e-6], 1, atol=1e-9)
    parallel = training_samples(subtasks, replace(configuration.metric, convergence=1e9), seed=0)[1]
    parallel = parallel.reshape(v.shape)
    np.testing.assert_allclose(parallel[:, :, 1], parallel[:, :, 0], atol=1e-9)
    np.testing.assert_allclose(np.sum(aside * subtasks.directions[:, :, 1::2], -1), 0, atol=1e-12)
    assert 0.005 < np.linalg.norm(aside, axis=-1).mean() < 0.02
    assert (aside[np.linalg.norm(x[:, :, 0], axis=-1) < 0.01] == 0).all()


def hook(turns: float) -> np.ndarray:
    """A planar spiral into the origin, [1, 60, 1, 3]."""
    s = np.linspace(1, 0, 60)
    x = 0.3 * np.stack([s * np.cos(turns * s), s * np.sin(turns * s), 0 * s], axis=-1)
    return x[None, :, None]


def test_the_width_with_the_best_alignment_among_clean_basins_is_chosen():
    points = hook(3.0)
    paths = subtask_trajectories([points[0], 1.01 * points[0]], samples=60)
    choice = choose_potential(
        paths.positions[0], paths.directions[0], 0, widths=(0.01, 0.04, 0.2), basin_starts=200, basin_margin=0.1
    )
    assert choice.trial.basin is not None
    assert choice.trial.basin.share_reached == 1.0
    clean = [t for t in choice.trials if t.basin is None or t.basin.share_reached == 1.0]
    assert choice.trial.alignment == max(t.alignment for t in clean)
    assert [t.width for t in choice.trials] == [0.01, 0.04, 0.2]


def test_no_clean_basin_and_no_fit_at_all_are_errors():
    paths = subtask_trajectories([hook(5.0)[0], 1.01 * hook(5.0)[0]], samples=60)
    arguments = paths.positions[0], paths.directions[0], 0
    with pytest.raises(BasinError, match=r"no kernel width .* share of starts that reach the goal: 0.1 m: \d+.\d%"):
        choose_potential(*arguments, widths=(0.1,), basin_starts=200, regularization=0.0)
    with pytest.raises(ConvexProgramError, match="no kernel width could be fitted. .*not 'optimal'"):
        choose_potential(paths.positions[0], 1e150 * paths.directions[0], 0, widths=(0.05,))


def test_a_skill_in_double_precision_follows_the_precision_of_its_input(learning):
    with jax.enable_x64(True):
        skill = jax.tree.map(lambda a: jnp.asarray(a, jnp.float64), learning.skill)
        for dtype in (jnp.float32, jnp.float64):
            form = jax.eval_shape(skill.tree(panda()), jnp.full(7, -0.5, dtype), jnp.zeros(7, dtype))
            assert form.f.dtype == form.M.dtype == dtype
