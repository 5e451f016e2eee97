"""Trials in native MuJoCo, with small policies in place of learned ones."""

from dataclasses import dataclass, fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import Batched, ConfigurationError, UnknownNameError, acceleration, pullback, pytree, scenes
from jaxrmp.cli._run import outcome_table, report_dict
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.leaves import Damping, Learned, Posture
from jaxrmp.simulation import (
    Displacement,
    TrackerSettings,
    Trial,
    learned_forms,
    run_trials,
    sample_trials,
    with_held,
)
from jaxrmp.world import Spheres, World

HOME = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], np.float32)
AWAY = HOME + np.array([0.3, 0.2, -0.2, 0.3, 0.2, -0.2, 0.4], np.float32)


@pytree
class ToPosture:
    """Goes to a posture; its first joint is turned by the object's position along x, as a goal that moves."""

    goal: Any
    stiffness: Any
    follow: Any = 0.0

    def tree(self, T_world_object, world):
        goal = self.goal.at[0].add(self.follow * T_world_object[0, 3])
        stiffness = jnp.asarray(self.stiffness)
        return Posture(goal, jnp.float32(1.0), stiffness, 2 * jnp.sqrt(jnp.abs(stiffness))) + Damping(
            jnp.float32(1e-3), jnp.float32(1.0)
        )


@pytest.fixture(scope="module")
def scene():
    return scenes.scene("drawer")


def policy(stiffness=25.0, follow=0.0):
    return ToPosture(jnp.asarray(AWAY), np.float32(stiffness), np.float32(follow))


@pytree
class Leaning(ToPosture):
    """As that, led aside by what is added to its posture."""

    def leaning(self, aside):
        return Leaning(self.goal + aside, self.stiffness)


def trial(scene, **changes):
    return Trial(HOME.astype(float), scene.T_world_object, **changes)


@pytest.mark.parametrize("interface", ["torque", "velocity", "position"])
def test_every_interface_takes_the_arm_where_the_policy_wants(scene, interface):
    run = run_trials(scene, policy(), [trial(scene)], limit=2.5, interface=interface)
    (outcome,), (trace,) = run.outcomes, run.traces
    np.testing.assert_allclose(trace.q[-1], AWAY, atol=0.01)
    assert not outcome.success and outcome.reason.startswith("not closed after 2 s: open by 150")
    assert outcome.saturated == 0 and outcome.final_error_m == pytest.approx(0.15, abs=1e-3)


def test_each_trial_is_led_aside_by_its_own(scene):
    asides = jnp.array([[0.0] * 7, [0.2] + [0.0] * 6])
    leaning = Leaning(jnp.asarray(AWAY), np.float32(25.0))
    traces = run_trials(scene, leaning, [trial(scene)] * 2, limit=2.5, aside=asides).traces
    for trace, aside in zip(traces, asides, strict=True):
        np.testing.assert_allclose(trace.q[-1], AWAY + aside, atol=0.01)


@pytest.mark.filterwarnings("ignore:some rows")
def test_obstacles_that_are_not_finite_are_counted(scene):
    @dataclass(frozen=True, eq=False)
    class Seen(type(scene)):
        def obstacles(self, T_world_object=None):
            return World(spheres=Spheres.of([((np.nan, 0, 0), 0.1), ((9, 9, 9), 0.1)]))

    seen = Seen(**{f.name: getattr(scene, f.name) for f in fields(scene)})
    run = run_trials(seen, policy(), [trial(scene)], limit=0.01)
    assert run.outcomes[0].ignored == 1
    assert "not finite were ignored in 1 trial, up to 1: [0]" in outcome_table(report_dict(run))


def test_saturation_is_reported_and_obeyed(scene):
    run = run_trials(scene, policy(4000.0), [trial(scene)], limit=0.3)
    (outcome,), (trace,) = run.outcomes, run.traces
    assert outcome.saturated > 0.01 and "panda_joint7" in outcome.saturated_joints
    limit = scene.model.actuator_ctrlrange[:, 1]
    assert (np.abs(trace.torque) <= limit).all()


def test_a_diverging_trial_is_stopped_and_the_others_go_on(scene):
    out_of_range = scene.T_world_object.copy()
    out_of_range[0, 3] = 3e38  # infinite, once the policy multiplies it by ten in single precision
    trials = [Trial(HOME.astype(float), out_of_range), trial(scene)]
    run = run_trials(scene, policy(follow=10.0), trials, limit=0.1)
    assert [o.diverged for o in run.outcomes] == [True, False]
    assert run.outcomes[0].reason == "diverged: the policy's acceleration is not finite"
    assert run.outcomes[1].time_s == pytest.approx(0.1) and np.isfinite(run.traces[1].qpos).all()


def test_a_silent_tracker_is_followed_for_a_while_and_then_the_arm_brakes(scene):
    tracker = TrackerSettings(jitter=(0, 0), drift=(0, 0), silent_after=0.1, keep=0.2)
    (outcome,), (trace,) = run_trials(scene, policy(4.0), [trial(scene)], limit=1.5, tracker=tracker)[2:]
    speed = np.linalg.norm(trace.qd, axis=1)
    assert 1.1 < outcome.braked_s < 1.3
    assert speed[trace.time < 0.28].max() > 0.1 and speed[-1] < 1e-3
    assert np.abs(trace.q[-1] - AWAY).max() > 0.1


def test_the_policy_follows_a_displaced_object_as_the_tracker_sees_it(scene):
    moves = Displacement(np.array([0.2, 0.0, 0.0]), start=0.2, duration=0.3)
    tracker = TrackerSettings(jitter=(0, 0), drift=(0, 0), delay=0.1)
    run = run_trials(
        scene,
        policy(follow=1.0),
        [trial(scene), trial(scene, displacement=moves)],
        limit=2.5,
        tracker=tracker,
    )
    still, displaced = run.traces
    assert displaced.q[-1, 0] - still.q[-1, 0] == pytest.approx(0.2, abs=0.01)
    assert displaced.T_world_object[-1, 0, 3] - scene.T_world_object[0, 3] == pytest.approx(0.2)
    middle = np.searchsorted(displaced.time, 0.35)
    assert displaced.T_seen[middle, 0, 3] < displaced.T_world_object[middle, 0, 3] - 0.03


def test_held_forms_are_those_of_the_instant_and_pull_back_through_the_present():
    robot = panda()
    leaf = Learned(Partial(lambda x: jnp.sum(x**2)), Partial(lambda x: jnp.eye(3) * (1 + jnp.sum(x**2))))
    tree = pullback(ControlPoints(robot, "panda_hand", np.zeros((1, 3))), Batched(leaf, shared=True)) + Damping(
        1.0, 5.0
    )
    q, qd = jnp.asarray(HOME), jnp.full(7, 0.2)
    held = with_held(tree, learned_forms(tree, q, qd))
    np.testing.assert_allclose(acceleration(held, q, qd), acceleration(tree, q, qd), rtol=1e-4, atol=1e-4)
    q = jnp.asarray(AWAY)
    live, stale = acceleration(tree, q, -qd), acceleration(held, q, -qd)
    assert np.abs(live - stale).max() > 0.1
    assert not any(leaf.certified for leaf in held.leaves() if leaf.name == "held")


def test_trials_begin_at_the_demonstrations_and_then_vary_by_seed(scene):
    paths, poses = [HOME[None].astype(float), AWAY[None].astype(float)], [scene.T_world_object] * 2
    few, many = (sample_trials(scene, paths, poses, n, seed=4) for n in (3, 6))
    np.testing.assert_array_equal(few[1].q, AWAY.astype(float))
    for a, b in zip(few, many, strict=False):
        np.testing.assert_array_equal(a.q, b.q)
    assert 0.01 < np.abs(many[2].q - paths[0][0]).max() <= 0.15
    door = scenes.scene("door")
    moved = sample_trials(door, paths[:1], [door.T_world_object], 5)[1:]
    offsets = [np.linalg.norm(t.T_world_object[:3, 3] - door.T_world_object[:3, 3]) for t in moved]
    assert 0.0 < max(offsets) <= 0.1
    displaced = sample_trials(scene, paths, poses, 4, displace=True)
    assert all(np.linalg.norm(t.displacement.offset) == pytest.approx(0.1) for t in displaced if t.displacement)
    assert len({t.displacement.start for t in displaced if t.displacement}) == 4


def test_mistakes_are_explained(scene):
    for call, error, message in (
        (lambda: run_trials(scene, policy(), []), ConfigurationError, "no trials to run"),
        (lambda: run_trials(scene, policy(), [trial(scene)], interface="pwm"), UnknownNameError, "'pwm'"),
        (lambda: run_trials(scene, policy(), [trial(scene)], learned_rate=0.0), ConfigurationError, "learned_rate is"),
        (lambda: run_trials(scenes.scene("door"), policy(), [trial(scene)]), ConfigurationError, "T_object_hand"),
        (lambda: sample_trials(scene, [], [], 0), ConfigurationError, "trials is 0"),
        (lambda: run_trials(scene, policy(), [trial(scene)], limit=0.0), ConfigurationError, "limit is 0.0"),
    ):
        with pytest.raises(error, match=message):
            call()


def test_batches_of_one_shape_compile_once(scene):
    from jaxrmp.simulation._run import _command

    before = _command._cache_size()  # type: ignore[attr-defined]
    for stiffness in (20.0, 30.0):
        run_trials(scene, policy(stiffness), [trial(scene)], limit=0.01)
    assert _command._cache_size() - before <= 1  # type: ignore[attr-defined]
    assert jax.tree.structure(policy(20.0)) == jax.tree.structure(policy(30.0))
