"""The loop that drives an arm, in MuJoCo: it reaches, keeps limits, and stops for every reason that it watches for."""

import dataclasses
import json
import re
import socket
import threading
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrmp
from jaxrmp import ArmError, ConfigurationError
from jaxrmp.cli import main
from jaxrmp.hardware import (
    DriveEnd,
    DriveSettings,
    Fixed,
    MujocoArm,
    SceneTracker,
    UdpSightings,
    check_log_folder,
    check_start,
    drive,
    law,
    save_mcap,
    save_motion,
    slots_of,
    to_posture,
)
from jaxrmp.kinematics import ControlPoints, load_robot_from_string
from jaxrmp.learning import load_demonstrations
from jaxrmp.leaves import Posture
from jaxrmp.policies import ArmPolicy, damping, posture, reaching_policy
from jaxrmp.scenes import arm_alone
from jaxrmp.simulation import TrackerSettings

START = np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.6, 0.8])


@pytest.fixture(scope="module")
def scene():
    return arm_alone("panda")


@pytest.fixture(scope="module")
def reach(scene):
    """A hand-designed policy, compiled for the arm, and a goal that it is taken to."""
    policy = reaching_policy(scene.robot, "panda_hand_tcp", START)
    T = np.eye(4)
    point = ControlPoints(scene.robot, ("panda_hand_tcp",))
    T[:3, 3] = np.asarray(point(jnp.asarray(START)))[0] + [0.05, 0.2, -0.1]
    T[:3, :3] = np.diag([1.0, -1.0, -1.0])
    return law(policy, MujocoArm(scene, START, real_time=False), obstacles=2), T, point


@pytest.fixture(scope="module")
def homing(scene):
    return law(to_posture(scene.robot, START + 0.3), MujocoArm(scene, START, real_time=False))


def arm_at(scene, q=START):
    return MujocoArm(scene, q, real_time=False)


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


def within_limits(sent, arm):
    """What was sent, and not what the reference says: its velocities, and their first and second differences."""
    acceleration = np.diff(sent, axis=0, prepend=0 * sent[:1]) / arm.period
    jerk = np.diff(acceleration, axis=0, prepend=0 * sent[:1]) / arm.period
    assert (np.abs(sent) <= arm.limits.velocity).all()
    assert (np.abs(acceleration) <= arm.limits.acceleration * 1.001).all()
    assert (np.abs(jerk[:-1]) <= arm.limits.jerk * 1.001).all()  # the last ends at zero


def stands(found, arm):
    """Whether a drive that was stopped ended with the arm at rest, braked within its limits."""
    arrays = found.log.arrays()
    qd, qdd = arrays["log_velocities_told"].astype(float), arrays["log_accelerations_told"].astype(float)
    within_limits(arrays["log_command"].astype(float), arm)
    assert (np.abs(qdd) <= arm.limits.acceleration).all()
    assert arrays["log_braking"][-1] and not arrays["log_braking"][0]
    for _ in range(300):
        state = arm.read()
    return np.abs(qd[-1]).max() < 1e-3 and np.abs(state.qd).max() < 0.02


class Sighted:
    """Sightings of a fixed pose, each changed by a function of how many there were."""

    def __init__(self, T, change):
        self._fixed, self._change, self._count = Fixed(T), change, 0

    def newest(self):
        self._count += 1
        return self._change(self._fixed.newest(), self._count)

    def close(self):
        pass


def test_a_tracker_that_goes_silent_stops_it(scene, reach):
    reaching, T, _ = reach
    arm = arm_at(scene)
    silent = Sighted(T, lambda seen, k: seen._replace(age=max(0.0, (k - 600) * 1e-3)))
    found = drive(arm, reaching, silent, DriveSettings(keep=0.3), start=START)
    assert found.end == DriveEnd.STOPPED and "tracker is silent" in found.reason
    assert stands(found, arm)


def test_a_policy_that_is_no_number_stops_it(scene):
    robot = scene.robot

    class Broken:
        def __init__(self):
            self.robot = robot

        def tree(self, T, world):
            return posture(robot, jnp.asarray(START) + 0.5 * jnp.sqrt(T[0, 3]), weight=1.0, stiffness=9.0) + damping()

    broken = law(Broken(), arm_at(scene))
    T = np.eye(4)
    T[0, 3] = 1.0
    negative = T.copy()
    negative[0, 3] = -1.0
    sights = Sighted(T, lambda seen, k: seen._replace(T_world_object=T if k < 700 else negative, number=k // 700))
    arm = arm_at(scene)
    found = drive(arm, broken, sights)
    assert found.end == DriveEnd.STOPPED and "not finite" in found.reason
    assert np.isfinite(found.log.arrays()["log_velocities_told"]).all()
    assert stands(found, arm)


def test_cycles_that_come_late_stop_it(scene, reach):
    reaching, T, _ = reach

    class Away(MujocoArm):
        def read(self):
            if 0.8 < self.data.time < 0.82:
                for _ in range(50):
                    super().read()
            return super().read()

    arm = Away(scene, START, real_time=False)
    found = drive(arm, reaching, Fixed(T), start=START)
    assert found.end == DriveEnd.STOPPED and "ms passed between two cycles" in found.reason and found.late >= 1
    assert stands(found, arm)


def test_what_is_in_its_way_stops_it(scene, reach):
    reaching, T, _ = reach

    class Held(MujocoArm):
        def read(self):
            state = super().read()
            if self.data.time > 0.7:  # somebody holds the arm
                self.data.qpos[self.scene.arm_qpos] = self.held
                self.data.qvel[self.scene.arm_dofs] = 0.0
            self.held = self.data.qpos[self.scene.arm_qpos].copy()
            return state

    arm = Held(scene, START, real_time=False)
    found = drive(arm, reaching, Fixed(T), start=START)
    assert found.end == DriveEnd.STOPPED and "something is in its way" in found.reason


def test_the_end_of_a_range_stops_it(scene):
    robot = scene.robot
    beyond = Posture(START + np.array([0, 0, 0, 0, 0, 4.0, 0]), weight=1.0, stiffness=4.0, damping_rate=3.0)
    policy = ArmPolicy(robot, (), beyond)
    arm = arm_at(scene)
    found = drive(arm, law(policy, arm), Fixed(np.eye(4)), DriveSettings(margin=0.01))
    assert found.end == DriveEnd.STOPPED and "joint 6 is at the end of its range" in found.reason
    assert found.state.q[5] < robot.upper[5]
    assert stands(found, arm)


def test_time_and_interruption_end_it(scene, reach):
    reaching, T, _ = reach
    arm = arm_at(scene)
    found = drive(arm, reaching, Fixed(T), DriveSettings(duration=0.8), start=START)
    assert found.end == DriveEnd.TIME and "within 0.8 s" in found.reason and stands(found, arm)
    arm, asked = arm_at(scene), iter(range(10_000))
    found = drive(arm, reaching, Fixed(T), start=START, running=lambda: next(asked) < 500)
    assert found.end == DriveEnd.INTERRUPTED and stands(found, arm)


def test_an_arm_that_gives_up_keeps_the_log(scene, reach):
    reaching, T, _ = reach

    class Gone(MujocoArm):
        def read(self):
            if self.data.time > 1.0:
                raise ArmError("the arm: its cable is out")
            return super().read()

    found = drive(Gone(scene, START, real_time=False), reaching, Fixed(T), start=START)
    assert found.end == DriveEnd.BY_ARM and "cable is out" in found.reason
    assert found.log.count > 500 and np.isfinite(found.log.arrays()["joint_positions"]).all()


def test_energy_that_rises_by_itself_stops_it(scene, reach):
    reaching, T, _ = reach
    calls = iter(range(10_000))

    def wrong(*arguments):  # a law whose energy rises though nothing is seen to change
        step = reaching.step(*arguments)
        return step._replace(energy=np.float32(10.0 + 0.02 * next(calls)))

    arm = arm_at(scene)
    found = drive(arm, reaching._replace(step=wrong), Fixed(T), start=START)
    assert found.end == DriveEnd.STOPPED and "energy rose" in found.reason and stands(found, arm)
    moving = Sighted(T, lambda seen, k: seen._replace(number=k))  # what moves may raise it
    found = drive(arm_at(scene), reaching._replace(step=wrong), moving, DriveSettings(duration=1.0), start=START)
    assert found.end == DriveEnd.TIME


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


def test_a_joint_that_is_too_fast_stops_it(scene, reach):
    reaching, T, _ = reach

    class Thrown(MujocoArm):
        def read(self):
            state = super().read()
            return state._replace(qd=state.qd + np.float32(4.0)) if self.data.time > 1.0 else state

    found = drive(Thrown(scene, START, real_time=False), reaching, Fixed(T), start=START)
    assert found.end == DriveEnd.STOPPED and "times its limit" in found.reason


class Lagging(MujocoArm):
    """An arm that drifts behind what it is told."""

    def read(self):
        state = super().read()
        return state._replace(q=state.q - np.float32(0.03))


@pytest.mark.parametrize("share", [1.0, 0.05])
def test_what_mends_drift_keeps_the_limits(scene, homing, share):
    arm = Lagging(scene, START, real_time=False)
    limits = {name: share * getattr(arm.limits, name) for name in ("velocity", "acceleration", "jerk")}
    arm.limits = dataclasses.replace(arm.limits, **limits)
    slow = homing if share == 1.0 else law(to_posture(scene.robot, START + 0.3), arm)
    found = drive(arm, slow, Fixed(np.eye(4)), DriveSettings(duration=2.0))
    assert found.log.count > 1000
    within_limits(found.log.arrays()["log_command"].astype(float), arm)


def test_whatever_fails_on_our_side_brakes_the_arm_and_keeps_the_log(scene, reach):
    reaching, T, _ = reach

    def broken(seen, k):
        if k > 600:
            raise KeyError("a tracker's own fault")
        return seen

    arm = arm_at(scene)
    found = drive(arm, reaching, Sighted(T, broken), start=START)
    assert found.end == DriveEnd.STOPPED and "a tracker's own fault" in found.reason and stands(found, arm)


def test_a_state_that_is_no_number_is_not_answered(scene, reach):
    reaching, T, _ = reach
    sent = []

    class Blind(MujocoArm):
        def read(self):
            state = super().read()
            return state._replace(q=state.q * np.nan, q_d=state.q_d * np.nan) if self.data.time > 1.0 else state

        def send(self, command, last=False):
            sent.append(np.isfinite(command).all())
            super().send(command, last)

    found = drive(Blind(scene, START, real_time=False), reaching, Fixed(T), start=START)
    assert found.end in (DriveEnd.STOPPED, DriveEnd.BY_ARM) and all(sent)
    with pytest.raises(ConfigurationError, match="not at the start"):
        check_start(np.full(7, np.nan), START, 0.1, scene.robot.joint_names)


def test_a_clock_that_goes_back_stops_it(scene, reach):
    reaching, T, _ = reach

    class Back(MujocoArm):
        def read(self):
            state = super().read()
            return state._replace(time=state.time - 100.0) if self.data.time > 1.0 else state

    arm = Back(scene, START, real_time=False)
    found = drive(arm, reaching, Fixed(T), start=START, interface="torque")
    assert found.end == DriveEnd.STOPPED and "clock" in found.reason
    assert np.abs(np.diff(found.log.arrays()["log_positions_told"], axis=0)).max() < 0.02


def test_a_reflex_while_it_ends_is_no_success(scene, reach):
    reaching, T, _ = reach

    class Reflex(MujocoArm):
        def send(self, command, last=False):
            if last:
                raise ArmError("the arm: reflex")
            super().send(command, last)

    found = drive(Reflex(scene, START, real_time=False), reaching, Fixed(T), start=START)
    assert found.end == DriveEnd.BY_ARM and "came to rest; then the arm: reflex" in found.reason


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


# The command line, in MuJoCo.


@pytest.fixture(scope="module")
def drawer(learned_drawer):
    return str(learned_drawer / "drawer_closing.skill.npz")


def test_a_skill_is_driven_in_its_scene_and_its_log_is_learned_from(drawer, tmp_path, capsys):
    log, report = tmp_path / "drives", tmp_path / "drive.json"
    command = ["drive", drawer, "--robot", "mujoco", "--scene", "drawer", "-q", "--late", "5"]
    assert main([*command, "--log", str(log), "--json", str(report)]) == 0
    found = json.loads(report.read_text())
    assert found["end"] == "rested" and found["goal_cm"] < 1.0 and found["mcap"]
    assert "came to rest" in capsys.readouterr().out
    assert main([*command[:3], "mujoco", "-q", "--late", "5", "--log", str(log), "--speed", "1.5"]) == 0
    assert len(load_demonstrations(log)) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--robot", "franka"], "needs --host"),
        (["--robot", "franka", "--scene", "drawer"], "--scene is for --robot mujoco"),
        (["--robot", "mujoco", "--start", "99"], "there are 0 to"),
        (["--robot", "mujoco", "--start", "1,2"], "has 7 joints"),
        (["--robot", "mujoco", "--start", "0,0,0,0,0,0,0"], "panda_joint4 would be outside"),
        (["--robot", "mujoco", "--tracker", "9870"], "expected udp:PORT"),
        (["--robot", "mujoco", "--speed", "5"], "at most 2"),
    ],
)
def test_mistakes_are_explained_before_an_arm_moves(drawer, options, message, capsys):
    assert main(["drive", drawer, *options, "-q"]) == 1
    assert message in capsys.readouterr().err


def test_a_dry_run_says_what_would_be_refused_and_where_the_object_is_said_to_be(drawer, capsys):
    away = "--at=0,-0.6,0,-2.2,0,1.6,0.8"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    T = np.eye(4)
    T[:3, 3] = 3.0, 0.0, 0.0
    ended = threading.Event()

    def track():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not ended.wait(0.05):
                out.sendto(json.dumps({"T_world_object": T.tolist()}).encode(), ("127.0.0.1", port))

    tracker = threading.Thread(target=track, daemon=True)
    tracker.start()
    try:
        command = ["drive", drawer, "--robot", "mujoco", away, "--dry-run", "-q", "--duration", "3"]
        assert main([*command, "--tracker", f"udp:{port}"]) == 0
    finally:
        ended.set()
        tracker.join()
    told = capsys.readouterr()
    assert "nothing is sent" in told.out
    assert "this is refused" in told.err and "from where it was in any demonstration" in told.err
