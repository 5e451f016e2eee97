"""Skills as fast as demonstrated: the latent motion in time, what pauses, and how late a rollout is."""

import pickle
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, FileWarning, ShapeError, TrainingError, UnknownNameError
from jaxrmp.cli._output import error_table, validation_table
from jaxrmp.cli._reproduce import result_dict
from jaxrmp.kinematics import panda
from jaxrmp.learning import (
    Fold,
    Validation,
    learn,
    load_configuration,
    load_skill,
    prepare,
    reproduce,
    save_skill,
    time_aligned_error,
)
from jaxrmp.learning._measures import mean_errors
from jaxrmp.learning._tempo import Tempo, demonstrated_tempo, radii
from jaxrmp.leaves import CruisingAttractor
from jaxrmp.simulation import rollout
from jaxrmp.synthetic import synthetic_demonstrations

CONFIGURATION = Path(__file__).parents[2] / "configs" / "door_reaching.toml"
FEW = {"method": "flow", "flow.updates": 1000, "policy.tempo": "demonstrated"}
PAUSE = 1.5  # s


@pytest.fixture(scope="module")
def hesitant():
    """Demonstrations that begin and end slowly and are nine times as fast in the middle; the first pauses there."""

    def retimed(k, demonstration):
        samples = len(demonstration.time)
        u = np.linspace(0, 1, samples)
        time = 5 * (u - 0.8 * np.sin(2 * np.pi * u) / (2 * np.pi))
        still = round(30 * PAUSE) if k == 0 else 0
        rows = np.insert(np.arange(samples), samples // 2, np.full(still, samples // 2))
        steps = np.insert(np.diff(time), samples // 2, np.full(still, 1 / 30))
        poses = {name: T if T.ndim == 2 else T[rows] for name, T in demonstration.poses.items()}
        return replace(demonstration, time=np.append(0.0, steps.cumsum()), q=demonstration.q[rows], poses=poses)

    found = synthetic_demonstrations("door_reaching", count=4)
    return replace(found, demonstrations=tuple(retimed(k, d) for k, d in enumerate(found)))


@pytest.fixture(scope="module")
def learning(once, hesitant):
    def make(folder):
        with pytest.warns(FileWarning, match=r"demonstration 0 pauses: 1\.[1-6] s from 2\.\d s on"):
            found = learn(load_configuration(CONFIGURATION, FEW), panda(), hesitant)
        (folder / "learning.pickle").write_bytes(pickle.dumps(found))

    return pickle.loads((once("door-tempo", make) / "learning.pickle").read_bytes())


def test_radii_are_where_an_attractor_is_at_each_time():
    tempo, times = Tempo(0.3, 0.1), np.linspace(0, 2.0, 101)
    found = radii(times, tempo, 40.0)
    leaf = CruisingAttractor(jnp.zeros(2), speed=tempo.speed, damping_rate=40.0, taper=tempo.taper)
    path = rollout(leaf, jnp.array([found[0], 0.0]), duration=2.0, dt=0.001)
    then = np.interp(times, path.time, path.q[:, 0])
    np.testing.assert_allclose(found, then, atol=1.5e-3)
    assert found[-1] == pytest.approx(0, abs=1e-9) and then[-1] == pytest.approx(1e-3, abs=2e-4)


@pytest.mark.parametrize(("damping_rate", "duration"), [(5.0, 0.5), (10.0, 1.0), (20.0, 0.5), (40.0, 20.0)])
def test_radii_fall_to_zero_however_short_a_demonstration_is(damping_rate, duration):
    found = radii(np.linspace(0, duration, 50), Tempo(0.3, 4 / damping_rate), damping_rate)
    assert (np.diff(found) <= 0).all() and (found >= 0).all()
    assert found[-1] == pytest.approx(0, abs=1e-9)
    assert found[0] < 0.3 * duration + 2e-3


def test_the_speed_found_is_that_of_a_motion_at_one_speed():
    times = np.linspace(0, 4.0, 400)
    path = radii(times, Tempo(0.25, 0.1), 40.0)[:, None] * [0.6, 0.8]
    assert demonstrated_tempo([path], [times], 40.0).speed == pytest.approx(0.25, rel=0.02)


def test_the_error_at_the_same_time_sees_a_delay_that_paths_do_not_show():
    times = np.linspace(0, 2, 101)
    demo = np.stack([0.1 * times, 0 * times, 0 * times], axis=1)[:, None]
    assert time_aligned_error(times, demo, times, demo) == 0
    assert time_aligned_error(times, demo, times + 0.2, demo) == pytest.approx(2.0, rel=0.1)  # 0.1 m/s, 0.2 s
    with pytest.raises(ShapeError, match="at 100 times"):
        time_aligned_error(times[:100], demo, times, demo)
    assert mean_errors([{"a": 1.0, "b": None}, {"a": 3.0, "b": None}]) == {"a": 2.0, "b": None}


def test_a_skill_is_where_it_was_demonstrated_to_be_at_each_time(learning, hesitant):
    (times, pausing), *others = zip(learning.prepared.joints.times, learning.prepared.joints.reports, strict=True)
    assert pausing.pauses_dropped == 1 and pausing.pauses[0][1] == pytest.approx(PAUSE, abs=0.5)
    assert all(not report.pauses for _, report in others) and times[-1] < 6
    mean = learning.reproduction.mean
    assert mean["time_aligned_cm"] < 3 * mean["dtw_cm"] < 3.0 and mean["goal_cm"] < 0.2
    assert mean["energy_increase"] <= 1e-3
    at_once = replace(learning.skill.configuration, policy=replace(learning.skill.configuration.policy, speed=0.15))
    even = learning.skill.with_gains(0.6 * float(learning.skill.flow.attractor.speed), 40.0)
    slow = reproduce(replace(even, configuration=at_once), panda(), learning.prepared).mean
    assert slow["time_aligned_cm"] > 5 * mean["time_aligned_cm"] and slow["dtw_cm"] < 1.0


def test_twice_the_speed_takes_half_the_time(learning):
    speed = float(learning.skill.flow.attractor.speed)
    taken = []
    for factor in (1, 2):
        found = reproduce(learning.skill.with_gains(factor * speed, 40.0 * factor), panda(), learning.prepared)
        points = found.points[0]
        away = np.linalg.norm(points - points[-1], axis=-1).max(-1) > 0.01
        taken.append(found.rollouts.time[0][np.flatnonzero(away)[-1]])
    assert taken[1] == pytest.approx(taken[0] / 2, rel=0.05)


def test_its_policy_is_certified(learning, assert_skill_certified):
    assert_skill_certified(learning)


def test_its_file_keeps_the_tempo_and_tables_show_the_error(learning, tmp_path):
    skill = load_skill(save_skill(learning.skill, tmp_path / "door.skill.npz"))
    assert skill.configuration.policy.tempo == "demonstrated"
    for a, b in zip(jax.tree.leaves(skill), jax.tree.leaves(learning.skill), strict=True):
        np.testing.assert_array_equal(a, b)
    result = result_dict(learning.reproduction, learning.skill, "test")
    assert f"{result['mean']['time_aligned_cm']:.2f}" in error_table(result).splitlines()[-1]
    errors = learning.reproduction.mean
    table = validation_table(Validation((Fold(0, "flow", errors, errors),)).as_dict())
    assert "training_time_aligned_cm" in table


def test_what_knows_one_speed_only_is_refused(hesitant):
    with pytest.raises(ConfigurationError, match="method 'paper', which knows one speed only"):
        load_configuration(CONFIGURATION, {"method": "paper", "policy.tempo": "demonstrated"})
    with pytest.raises(UnknownNameError, match="tempo"):
        load_configuration(CONFIGURATION, {"policy.tempo": "as shown"})
    wild = {"flow.updates": 100, "flow.learning_rate": 10.0, "flow.conditioning": 0.0, "method": "auto"}
    with pytest.raises(TrainingError, match="cannot take over with policy.tempo 'demonstrated'"):
        learn(load_configuration(CONFIGURATION, FEW | wild), panda(), hesitant)


def test_times_leave_pauses_out_and_joints_are_found_between_them(hesitant):
    joints = prepare(load_configuration(CONFIGURATION), panda(), hesitant).joints
    at, q = joints.in_time(50)
    assert at.shape == (4, 50) and q.shape == (4, 50, 7)
    for k in range(4):
        assert len(joints.times[k]) == len(joints.timed[k]) and np.diff(joints.times[k]).min() > 0
        np.testing.assert_allclose(q[k][[0, -1]], joints.q[k][[0, -1]], atol=1e-9)
    assert joints.times[0][-1] == pytest.approx(joints.times[1][-1], abs=0.5)
