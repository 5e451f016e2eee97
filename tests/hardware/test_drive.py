"""The loop that drives an arm, in MuJoCo: it reaches, keeps limits, and writes what it did."""

import dataclasses
import json
import re
import socket
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrmp
from jaxrmp import ArmError, ConfigurationError
from jaxrmp.hardware import (
    DriveEnd,
    DriveSettings,
    Fixed,
    MujocoArm,
    SceneTracker,
    UdpSightings,
    check_log_folder,
    drive,
    law,
    save_mcap,
    save_motion,
    slots_of,
    to_posture,
)
from jaxrmp.kinematics import load_robot_from_string
from jaxrmp.learning import load_demonstrations
from jaxrmp.policies import ArmPolicy, posture
from jaxrmp.scenes import arm_alone
from jaxrmp.simulation import TrackerSettings

from .conftest import START, arm_at


@pytest.mark.parametrize("interface", ["velocity", "torque"])
def test_an_arm_is_taken_to_its_goal_within_its_limits_and_logged(scene, reach, interface):
    reaching, T, point = reach
    arm = arm_at(scene)
    found = drive(arm, reaching, Fixed(T), start=START, interface=interface, names=scene.robot.joint_names)
    assert found.end == DriveEnd.RESTED and found.reason == "came to rest"
    hand = np.asarray(point(jnp.asarray(found.state.q)))[0]
    assert np.linalg.norm(hand - T[:3, 3]) < 0.005
    arrays = found.log.arrays()
    assert len(arrays["time"]) == found.log.count == len(arrays["joint_positions"])
    qd, qdd = arrays["log_velocities_told"].astype(float), arrays["log_accelerations_told"].astype(float)
    assert (np.abs(qd) <= arm.limits.velocity).all() and (np.abs(qdd) <= arm.limits.acceleration).all()
    assert (np.abs(np.diff(qdd, axis=0)) <= arm.limits.jerk * arm.period * 1.001).all()
    assert arrays["log_energy"][-600] < 1e-2 * arrays["log_energy"][0]
    assert np.abs(arm.data.qvel).max() < 0.01, "it stands"


def test_speed_scales_time_and_not_the_way(scene, reach):
    reaching, T, _ = reach
    ways = []
    for speed in (1.0, 0.5):
        found = drive(arm_at(scene), reaching, Fixed(T), DriveSettings(speed=speed), start=START)
        assert found.end == DriveEnd.RESTED
        arrays = found.log.arrays()
        ways.append((arrays["joint_positions"], np.abs(arrays["log_velocities_told"]).max()))
    (fast, fastest), (slow, slowest) = ways
    assert 0.45 < slowest / fastest < 0.55
    nearest = np.array([np.linalg.norm(fast - q, axis=1).min() for q in slow[::50]])
    assert nearest.max() < 0.02


def test_obstacles_told_are_kept_off(scene, reach):
    reaching, T, point = reach
    hand = np.asarray(point(jnp.asarray(START)))[0]
    middle = 0.5 * (hand + T[:3, 3]) + [0.0, 0.0, 0.02]
    least = []
    for balls in ((), [[*middle, 0.05]]):
        found = drive(arm_at(scene), reaching, Fixed(T, balls), DriveSettings(duration=4.0), start=START)
        way = np.asarray(jax.vmap(point)(jnp.asarray(found.log.arrays()["joint_positions"])))[:, 0]
        least.append(np.linalg.norm(way - middle, axis=1).min())
    assert least[0] < 0.05 < least[1]


def test_it_starts_near_its_start_alone(scene, reach):
    reaching, T, _ = reach
    arm = arm_at(scene, START + 0.2)
    with pytest.raises(ConfigurationError, match=r"not at the start: .*by 0\.20.*--go"):
        drive(arm, reaching, Fixed(T), start=START)
    assert arm.data.time < 1.0 and np.abs(arm.data.qvel).max() < 0.01
    with pytest.raises(ConfigurationError, match="no interface 'position'"):
        drive(arm, reaching, Fixed(T), interface="position")


def test_an_arm_that_does_not_stand_still_is_not_driven(scene, reach):
    arm = arm_at(scene)
    arm.start("velocity")
    arm.send(np.full(7, 0.1))
    with pytest.raises(ArmError, match="does not stand still"):
        drive(arm, reach[0], Fixed(reach[1]))


def test_it_goes_to_a_posture(scene, homing):
    found = drive(arm_at(scene), homing, Fixed(np.eye(4)))
    assert found.end == DriveEnd.RESTED
    np.testing.assert_allclose(found.state.q, START + 0.3, atol=0.01)


def test_a_policy_for_another_arm_is_refused(scene):
    arm = load_robot_from_string(
        '<robot name="a"><link name="b"/><link name="c"/><joint name="j" type="revolute"><parent link="b"/>'
        '<child link="c"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    with pytest.raises(ConfigurationError, match="of 1 joints"):
        law(ArmPolicy(arm, (), posture(arm)), arm_at(scene))


def test_a_leaf_without_energy_is_not_watched(scene):
    @jaxrmp.pytree
    class Push(jaxrmp.Leaf):
        certified = False

        def __call__(self, x, xd):
            return jaxrmp.NaturalForm(jnp.zeros_like(x), jnp.zeros((len(x), len(x)), x.dtype))

    arm = arm_at(scene)
    found = law(ArmPolicy(scene.robot, (), posture(scene.robot, START) + Push()), arm)
    assert found.uncertified


def test_logs_are_demonstrations_and_bags(scene, reach, tmp_path):
    reaching, T, _ = reach
    robot, folder = scene.robot, tmp_path / "drives"
    for k in range(2):
        found = drive(arm_at(scene), reaching, Fixed(T), DriveSettings(duration=1.0 + 0.2 * k), start=START)
        arrays = found.log.arrays()
        save_motion(arrays, folder, robot.name, robot.joint_names, "cup")
        save_mcap(arrays, folder / "mcap" / f"demo_{k}", robot.joint_names, "cup")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = load_demonstrations(folder)
    assert read.joint_names == robot.joint_names and read.object_names == ("cup",)
    np.testing.assert_allclose(read[1].q, arrays["joint_positions"])
    np.testing.assert_allclose(read[1].pose("cup"), T, atol=1e-6)
    bags = load_demonstrations(folder / "mcap", robot=robot, tracked="cup")
    np.testing.assert_allclose(bags[1].q, arrays["joint_positions"], atol=1e-6)
    check_log_folder(folder, robot.name, robot.joint_names, "cup")
    for others in (("other", robot.joint_names, "cup"), (robot.name, robot.joint_names, "door")):
        with pytest.raises(jaxrmp.DemonstrationError, match="log to another folder"):
            check_log_folder(folder, *others)
    assert not [entry for entry in folder.rglob("*") if ".partial" in entry.name]


def test_a_full_log_says_so(scene, reach):
    from jaxrmp.hardware import Log

    reaching, T, _ = reach
    arm = arm_at(scene)
    state, seen = arm.read(), Fixed(T).newest()
    zeros = np.zeros(7, np.float32)
    step = reaching.step(T, slots_of(reaching, seen), state.q, state.q, zeros, zeros, zeros, np.float32(1))
    log = Log(7, 2)
    for k in range(3):
        assert log.full == (k > 2)
        log.add(state, 0.001, seen, step, step.command, False, 1e-4)
    assert log.full and log.count == 2


def test_poses_come_as_datagrams():
    sights = UdpSightings(("127.0.0.1", 0), obstacles=1)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:

            def say(content):
                raw = content if isinstance(content, bytes) else json.dumps(content).encode()
                out.sendto(raw, ("127.0.0.1", sights.port))

            with pytest.raises(ConfigurationError, match="no pose of the object came to UDP port"):
                sights.wait(0.05)
            T = np.eye(4)
            T[:3, 3] = 1, 2, 3
            say({"T_world_object": T.tolist()})
            sights.wait(5.0)
            first = sights.newest()
            np.testing.assert_allclose(first.T_world_object, T)
            assert first.obstacles.shape == (0, 4) and first.age < 5.0
            for content, why in (
                (b"\xff", "decode"),
                ({"T_world_object": (2 * T).tolist()}, "last row|rotation"),
                ({"T_world_object": [1, 2, 3]}, "shape"),
                ({"obstacles": [[0, 0, 0, 1], [0, 0, 1, 1]]}, "slots for 1"),
                ({"pose": 1}, "unknown"),
                ({"obstacles": [[0, 0, float("nan"), 1]]}, "not finite"),
                ({"obstacles": [[0, 0, 0, -1]]}, "negative radius"),
                (b"[" * 60_000, "recursion"),
                (b'{"age": 1' + b"0" * 400 + b"}", "too large"),
                ([1], "JSON object"),
            ):
                before = sights.unread
                say(content)
                while sights.unread == before:
                    sights.newest()
                assert re.search(why, sights.why), sights.why
            say({"obstacles": [[0, 0, 1, 0.1]], "age": 0.25})
            while (seen := sights.newest()).number == first.number:
                pass
            np.testing.assert_allclose(seen.T_world_object, T)
            np.testing.assert_allclose(seen.obstacles, [[0, 0, 1, 0.1]])
            assert 0.25 <= seen.age < 5.0
            say({"T_world_object": T.tolist()})
            say({"obstacles": []})
            while sights.newest().number < seen.number + 2:
                pass
            np.testing.assert_allclose(sights.newest().T_world_object, T)
            aged = sights.newest().age
            say({"obstacles": []})
            while sights.newest().number < seen.number + 3:
                pass
            assert sights.newest().age >= aged, "news of obstacles is none of the pose"
        for port in (sights.port, 99_999):
            with pytest.raises(ConfigurationError, match="cannot listen"):
                UdpSightings(("127.0.0.1", port))
    finally:
        sights.close()


def test_a_scene_s_object_is_seen_through_a_camera(scene):
    arm = arm_at(scene)
    perfect, camera = SceneTracker(arm), SceneTracker(arm, TrackerSettings(silent_after=0.2))
    ages = []
    for _ in range(800):
        arm.read()
        ages.append(camera.newest().age)
    assert perfect.newest().age == 0.0 and max(ages[:150]) < 0.04 and ages[-1] > 0.5


def test_torques_do_not_shake_a_light_wrist(tmp_path):
    def link(name, mass, inertia):
        return (
            f'<link name="{name}"><inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/><inertia ixx="{inertia}" '
            f'iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )

    def joint(name, parent, child, axis):
        return (
            f'<joint name="{name}" type="revolute"><origin xyz="0 0 0.2"/><parent link="{parent}"/>'
            f'<child link="{child}"/><axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="3" effort="54"/></joint>'
        )

    (tmp_path / "arm.urdf").write_text(
        '<robot name="light"><link name="base"/>'
        + link("upper", 3.0, 0.03)
        + link("wrist", 0.1, 0.0001)
        + joint("lift", "base", "upper", "0 1 0")
        + joint("turn", "upper", "wrist", "0 0 1")
        + "</robot>"
    )
    place = arm_alone(tmp_path / "arm.urdf")
    arm = MujocoArm(place, np.zeros(2), real_time=False)
    goal = np.array([0.5, -0.8])
    found = drive(arm, law(to_posture(place.robot, goal), arm), Fixed(np.eye(4)), interface="torque")
    assert found.end == DriveEnd.RESTED, found.reason
    np.testing.assert_allclose(found.state.q, goal, atol=0.02)
    assert np.abs(found.log.arrays()["log_velocities"]).max() < 3.0


def test_more_obstacles_than_slots_are_refused_before_it_moves(scene, reach, homing):
    reaching, T, _ = reach
    ball = [0.5, 0.0, 0.9, 0.05]
    for compiled, count in ((reaching, 3), (homing, 1)):
        with pytest.raises(ConfigurationError, match="slots for"):
            drive(arm_at(scene), compiled, Fixed(T, [ball] * count))


def test_settings_that_make_no_sense():
    for settings, message in (
        ({"speed": 0.0}, "drive.speed"),
        ({"speed": 3.0}, "at most 2"),
        ({"rise": 1.0}, "rise"),
        ({"duration": 1e9}, "memory"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            DriveSettings(**settings)
    with pytest.raises(jaxrmp.RigidTransformError):
        Fixed(np.zeros((4, 4)))
    assert dataclasses.replace(DriveSettings(), speed=0.5).speed == 0.5
