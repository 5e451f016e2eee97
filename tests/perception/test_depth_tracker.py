"""Trials in physics whose policy knows of the object what a depth camera sees, and where that camera stands."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from jaxrmp import ConfigurationError, ShapeError, pytree, scenes
from jaxrmp.cli import main
from jaxrmp.kinematics import forward_kinematics
from jaxrmp.perception import depth_tracker, looked_at, object_model, overhead_camera
from jaxrmp.policies import reaching_policy
from jaxrmp.simulation import Displacement, Trial, run_trials
from jaxrmp.synthetic import synthetic_demonstrations
from jaxrmp.world import RobotSpheres, panda_spheres

from .conftest import T_WORLD_OBJECT, model_and_data, thing

SIZE = dict(width=320, height=240)


@pytree
class ToHandle:
    """Takes the hand to a pose in the object's frame."""

    reaching: Any
    T_object_hand: Any

    def tree(self, T_world_object, world):
        return self.reaching.tree(T_world_object @ self.T_object_hand, world)


@pytest.fixture(scope="module")
def door():
    """The door, its policy, the start of a trial a short way before the end of a demonstration, and its camera."""
    place = scenes.scene("door")
    shown = synthetic_demonstrations("door_reaching").demonstrations[0]
    T, q = shown.pose("door_handle"), shown.q
    hand = np.asarray(forward_kinematics(place.robot, np.asarray(q[-1], np.float32), "panda_hand"))
    none = RobotSpheres((), np.zeros((0, 3)), np.zeros(0))
    reaching = reaching_policy(place.robot, "panda_hand", spheres=none)
    policy = ToHandle(reaching, (np.linalg.inv(T) @ hand).astype(np.float32))
    goal = np.linalg.inv(T) @ place.hand_pose(place.with_object(T).data(q[-1]))
    model = object_model(place.model, place.object, 1500)
    camera = overhead_camera(model, T[None], np.zeros(1), **SIZE)
    return replace(place, T_object_hand=goal), policy, Trial(q[int(0.8 * len(q))], T), model, camera


@pytest.fixture(scope="module")
def tracker(door):
    place, _, _, model, camera = door
    with depth_tracker(place, model, camera, panda_spheres(), keep=0.2) as found:
        yield found


def test_the_door_is_reached_by_what_the_camera_sees_while_it_is_moved(door, tracker):
    place, policy, trial, _, _ = door
    moved = trial._replace(displacement=Displacement(np.array([0.03, -0.04, 0.0]), start=0.3, duration=0.3))
    (outcome,), (trace,) = run_trials(place, policy, [moved], limit=8.0, hold=0.3, tracker=tracker)[2:]
    assert outcome.success, outcome.reason
    seen = outcome.tracking
    assert seen.images == int(30 * outcome.time_s + 1e-6) and seen.lost == 0 and outcome.braked_s == 0
    assert 0 < seen.position_m < 0.005 and seen.angle_deg < 1.0 and abs(seen.joints["door_hinge"]) < 0.02
    told, true = trace.T_seen[:, :3, 3], trace.T_world_object[:, :3, 3]
    assert (told != true).any(1).all(), "the policy was told of the true pose"
    np.testing.assert_allclose(told[-1], true[-1], atol=0.004)


def test_where_the_object_is_lost_the_arm_brakes_and_the_pose_stays(door, tracker):
    place, policy, trial, _, _ = door
    gone = trial._replace(displacement=Displacement(np.array([0.0, 0.0, 5.0]), start=0.1, duration=0.001))
    (outcome,), (trace,) = run_trials(place, policy, [gone], limit=1.2, tracker=tracker)[2:]
    assert 0.7 < outcome.braked_s < 1.0 and not outcome.success
    assert np.linalg.norm(trace.qd[-1]) < 1e-3 < np.linalg.norm(trace.qd, axis=1).max()
    assert outcome.tracking.lost > 25
    assert np.linalg.norm(trace.T_seen[-1, :3, 3] - trial.T_world_object[:3, 3]) < 0.01


def test_the_seed_decides_what_is_seen(door, tracker):
    place, _, trial, _, _ = door
    data = place.at(trial).data(trial.q)
    first, again, other = (tracker.start(place, data, seed) for seed in [(0, 1), (0, 1), (0, 2)])
    np.testing.assert_array_equal(first.seen, again.seen)
    later = [tracker.observe(sight, 0.05, place, data) for sight in (first, again)]
    np.testing.assert_array_equal(later[0].seen, later[1].seen)
    assert (first.seen != other.seen).any() and (later[0].seen != first.seen).any()
    assert tracker.observe(first, 0.02, place, data) is first, "no image is due"
    assert first.stamp == 0.0 and later[0].stamp == 0.05 and tracker.age(later[0], 0.15) == pytest.approx(0.1)


def test_a_camera_stands_where_most_is_seen_and_goes_round_what_hides_it():
    m, _ = model_and_data()
    model, poses, q = thing(m), T_WORLD_OBJECT[None], np.array([0.0, 0.0])
    free = overhead_camera(model, poses, q, elevation=0.5, **SIZE)
    eye, target = np.asarray(free.T_world_camera)[:3, 3], looked_at(model, poses, q)
    assert np.linalg.norm(eye - target) == pytest.approx(1.0) and eye[2] - target[2] == pytest.approx(np.sin(0.5))
    assert eye[1] < target[1] - 0.5, "doors and drawers are at the side of negative y"
    np.testing.assert_allclose(np.asarray(free.T_world_camera)[:3, 2], target - eye, atol=1e-6)
    arm = (0.5 * (eye + target))[None, None, None]
    beside = overhead_camera(model, poses, q, arm, [0.2], elevation=0.5, **SIZE)
    assert np.linalg.norm(np.asarray(beside.T_world_camera)[:3, 3] - eye) > 0.2


def test_what_is_looked_at_is_what_the_joints_move():
    m, data = model_and_data(hinge=0.0, slide=0.0)
    moving = [data.geom(name).xpos for name in ("panel", "front")]
    found = looked_at(thing(m), T_WORLD_OBJECT[None], np.zeros(2))
    assert np.linalg.norm(found - np.mean(moving, axis=0)) < 0.05


def test_mistakes_in_placing_a_camera_are_explained(door):
    place, _, trial, model, camera = door
    poses, q = trial.T_world_object[None], np.zeros(1)
    with pytest.raises(ConfigurationError, match="distance of overhead_camera is 0"):
        overhead_camera(model, poses, q, distance=0.0)
    with pytest.raises(ConfigurationError, match="elevation of overhead_camera is 2"):
        overhead_camera(model, poses, q, elevation=2.0)
    with pytest.raises(ShapeError, match=r"centers have shape \(2, 1, 1, 3\), expected \(1, S, 1, 3\)"):
        overhead_camera(model, poses, q, np.zeros((2, 1, 1, 3)), [0.1])
    with pytest.raises(ShapeError, match=r"poses have shape \(4, 4\)"):
        looked_at(model, poses[0], q)
    with (
        pytest.raises(ConfigurationError, match="keep of depth_tracker is 0"),
        depth_tracker(place, model, camera, keep=0.0),
    ):
        pass


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--camera", "depth", "--tracker", "on"], "--tracker models how it is seen: give one of both"),
        (["--camera", "depth", "--tracker-delay", "0.1"], "--tracker-delay models how it is seen"),
        (["--camera-distance", "2"], "add --camera depth"),
        (["--camera", "depth", "--camera-distance", "2", "--camera-at", "1,1,1"], "give one of both"),
    ],
)
def test_a_camera_and_a_tracker_without_one_exclude_each_other(arguments, message, capsys):
    assert main(["run", "none.skill.npz", "--scene", "door", *arguments]) == 1
    assert message in capsys.readouterr().err


def test_a_scene_without_an_object_has_nothing_to_look_for():
    alone = scenes.arm_alone()
    from jaxrmp.cli._camera import scene_camera

    with pytest.raises(ConfigurationError, match="has no object to look for"), scene_camera(None, alone, None, None):
        pass
