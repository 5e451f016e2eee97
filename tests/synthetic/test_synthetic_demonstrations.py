"""The scripted demonstrator."""

import jax
import numpy as np
import pytest

from jaxrmp import DemonstrationError, UnknownNameError
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.learning import load_demonstrations
from jaxrmp.learning._preprocessing import preprocess
from jaxrmp.learning._subtask_trajectories import end_spread
from jaxrmp.synthetic import SYNTHETIC_TASKS, synthetic_demonstrations, write_synthetic_demonstrations
from jaxrmp.synthetic._motion import Rotation, minimum_jerk, through

GRIPPER = ((0.0, 0.0, 0.207),)


@pytest.fixture(scope="module", params=SYNTHETIC_TASKS)
def task(request):
    return request.param, synthetic_demonstrations(request.param)


def gripper_paths(trajectories):
    with jax.enable_x64(True):
        points = jax.jit(jax.vmap(ControlPoints(panda(), ("panda_link7",), np.array(GRIPPER))))
        return [np.asarray(points(q)) for q in trajectories]


def test_they_are_recorded_like_real_ones(task):
    name, demonstrations = task
    assert len(demonstrations) == 6
    assert demonstrations.source == "synthetic"
    assert demonstrations.joint_names == panda().joint_names
    assert demonstrations.object_names == (("door_handle",) if name == "door_reaching" else ())
    for d in demonstrations:
        steps = np.diff(d.time)
        assert np.median(steps) == pytest.approx(1 / 30, abs=1e-3)
        assert steps.std() > 1e-4
        assert (d.q > panda().lower + 0.05).all() and (d.q < panda().upper - 0.05).all()
        assert (np.abs(np.diff(d.q, axis=0)) < np.asarray(panda().velocity_limit) / 30).all()


def test_their_motions_have_the_scale_of_the_experiments(task):
    _, demonstrations = task
    processed = preprocess(demonstrations)
    assert all(r.trimmed_start > 0.3 and r.trimmed_end > 0.3 for r in processed.reports)
    paths = gripper_paths(processed.q)
    for path in paths:
        assert 0.5 < np.linalg.norm(np.diff(path[:, 0], axis=0), axis=1).sum() < 1.4
    starts = np.stack([path[0, 0] for path in paths])
    assert np.linalg.norm(starts - starts.mean(axis=0), axis=1).max() > 0.08
    assert end_spread(paths).max() < 0.08


def test_the_drawer_is_pushed_along_a_line_with_the_wrist_aligned():
    path = gripper_paths(preprocess(synthetic_demonstrations("drawer_closing", count=2)).q)[0][:, 0]
    push = path[np.linalg.norm(path - path[-1], axis=1) < 0.12]
    direction = (push[-1] - push[0]) / np.linalg.norm(push[-1] - push[0])
    off_line = (push - push[0]) - np.outer((push - push[0]) @ direction, direction)
    assert np.linalg.norm(off_line, axis=1).max() < 0.01


def test_the_tracker_is_noisy_and_the_arc_goes_round_the_door():
    demonstrations = synthetic_demonstrations("door_reaching", count=2)
    T = demonstrations[0].poses["door_handle"]
    noise = np.linalg.norm(T[:, :3, 3] - T[:, :3, 3].mean(axis=0), axis=1)
    assert 0.002 < noise.mean() < 0.008
    path = gripper_paths(preprocess(demonstrations).q)[0][:, 0]
    assert path[:, 0].min() < path[-1, 0] - 0.05  # beyond the handle, then back to it
    assert path[:, 1].max() > path[-1, 1] + 0.15
    assert 0.02 < np.linalg.norm(path[-1] - T[:, :3, 3].mean(axis=0)) < 0.12


def test_the_seed_says_everything():
    a, b, c = (synthetic_demonstrations("drawer_closing", seed=seed, count=2) for seed in (3, 3, 4))
    np.testing.assert_array_equal(a[1].q, b[1].q)
    np.testing.assert_array_equal(a[1].time, b[1].time)
    assert a[0].q.shape != c[0].q.shape or np.abs(a[0].q - c[0].q).max() > 1e-2


def test_they_can_be_written_to_a_folder(tmp_path):
    folder = write_synthetic_demonstrations("door_reaching", tmp_path / "door", count=2)
    loaded = load_demonstrations(folder)
    assert (loaded.source, loaded.robot, len(loaded)) == ("synthetic", panda().name, 2)


def test_an_unknown_task_and_too_few_are_refused():
    with pytest.raises(
        UnknownNameError, match=r"unknown synthetic task 'drawer_closng'\. Did you mean 'drawer_closing'"
    ):
        synthetic_demonstrations("drawer_closng")
    with pytest.raises(DemonstrationError, match="at least two"):
        synthetic_demonstrations("drawer_closing", count=1)


def test_minimum_jerk_rests_at_both_ends():
    s = minimum_jerk(np.array([-1.0, 0.0, 0.5, 1.0, 2.0]))
    np.testing.assert_allclose(s, [0.0, 0.0, 0.5, 1.0, 1.0])
    motion = through(np.eye(3), [Rotation.identity()] * 3, speed=0.5, overlap=0.3, rng=np.random.default_rng(0))
    position, rotation = motion(np.array([0.0, motion.duration]))
    np.testing.assert_allclose(position, np.eye(3)[[0, 2]], atol=1e-12)
    np.testing.assert_allclose(rotation.magnitude(), 0.0, atol=1e-12)
