"""A Franka over its network protocol, spoken by simulators in processes of their own (`make simulators`).

They run in real time. Tests assert what happens, not how fast: on a machine in use a cycle may come late, so that how
late one may be is set wide, except where lateness is what is tested.
"""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import filelock
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks._franka_simulators import missing, simulator
from jaxrmp import ArmError, learning
from jaxrmp.hardware import DriveEnd, DriveSettings, Fixed, FrankaArm, drive, law, record, to_posture
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.policies import reaching_policy, whole_arm_policy
from jaxrmp.simulation import rollout
from jaxrmp.world import World

HOME = np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.785])
PATIENT = DriveSettings(late=0.5)
NAMES = panda().joint_names
GUIDED = Path(__file__).with_name("guided_franka.py")

pytest.importorskip("pylibfranka", reason="pylibfranka is not installed: pip install 'jaxrmp[franka]'")


@pytest.fixture(scope="module", autouse=True)
def alone(tmp_path_factory):
    """One simulator at a time on this machine: they all listen at the same port."""
    with filelock.FileLock(Path(os.environ.get("TMPDIR", "/tmp")) / "jaxrmp-franka.lock", timeout=900):
        yield


def started(name, tmp_path_factory, **options):
    if why := missing(name):
        pytest.skip(why)
    return simulator(name, tmp_path_factory.mktemp("simulator"), **options)


@pytest.fixture
def franky(tmp_path_factory):
    with started("franky-sim", tmp_path_factory) as found:
        yield found


@pytest.fixture
def strict(tmp_path_factory):
    """The one that ends motions for limits of motion. For lost cycles it does so in the benchmark alone: here, other
    tests run beside."""
    with started("franka-sim", tmp_path_factory, options=["--enforce-motion-limits"]) as found:
        yield found


@pytest.fixture(params=["franky", "strict"])
def any_franka(request):
    return request.getfixturevalue(request.param)


def reaching(arm):
    """A reach of 30 cm, its law, its goal, and where the hand is."""
    robot = panda()
    point = ControlPoints(robot, ("panda_hand_tcp",))
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = np.asarray(point(jnp.asarray(HOME)))[0] + [-0.05, 0.25, -0.1]
    policy = reaching_policy(robot, "panda_hand_tcp", HOME)
    return law(policy, arm), policy, T, point


def test_a_reach_keeps_the_arm_s_limits_and_the_policy_s_way(any_franka):
    arm = FrankaArm(any_franka.host, "ignore")
    reach, policy, T, point = reaching(arm)
    found = drive(arm, reach, Fixed(T), PATIENT, start=HOME, names=NAMES)
    assert found.end == DriveEnd.RESTED, found.reason
    assert not any_franka.violations
    way = np.asarray(jax.vmap(point)(jnp.asarray(found.log.arrays()["joint_positions"])))[:, 0]
    assert np.linalg.norm(way[-1] - T[:3, 3]) < 0.005
    kinematic = rollout(policy.tree(jnp.asarray(T), World()), jnp.asarray(HOME), duration=6.0, dt=0.002)
    expected = np.asarray(jax.vmap(point)(kinematic.q))[:, 0]
    off = np.array([np.linalg.norm(expected - p, axis=1).min() for p in way[::20]])
    assert off.max() < 0.01
    arm.close()


def test_torques_take_it_there_too(any_franka):
    arm = FrankaArm(any_franka.host, "ignore")
    reach, _, T, point = reaching(arm)
    found = drive(arm, reach, Fixed(T), PATIENT, start=HOME, interface="torque", names=NAMES)
    assert found.end == DriveEnd.RESTED, found.reason
    assert not any_franka.violations
    assert np.linalg.norm(np.asarray(point(jnp.asarray(found.state.q)))[0] - T[:3, 3]) < 0.01
    arm.close()


def test_motions_follow_each_other(strict):
    arm = FrankaArm(strict.host, "ignore")
    for posture in (HOME + 0.2, HOME):
        found = drive(arm, law(to_posture(panda(), posture), arm), Fixed(np.eye(4)), PATIENT)
        assert found.end == DriveEnd.RESTED, found.reason
        np.testing.assert_allclose(found.state.q, posture, atol=0.01)
    assert not strict.violations
    arm.close()


def test_a_cable_that_is_pulled_ends_it_with_the_log(franky):
    arm = FrankaArm(franky.host, "ignore")
    reach, _, T, _ = reaching(arm)
    pull = threading.Timer(0.8, franky.process.send_signal, (signal.SIGSTOP,))

    def from_first():  # the time counts from the motion's begin
        if not pull.ident:
            pull.start()
        return True

    found = drive(arm, reach, Fixed(T), PATIENT, start=HOME, running=from_first)
    assert found.end == DriveEnd.BY_ARM and "Franka" in found.reason
    assert found.log.count > 20 and np.isfinite(found.log.arrays()["joint_positions"]).all()


def test_a_process_that_was_stopped_brakes_the_arm(franky):
    arm = FrankaArm(franky.host, "ignore")
    reach, _, T, _ = reaching(arm)
    stop = f"import os, signal, time; time.sleep(.8); os.kill({os.getpid()}, signal.SIGSTOP); time.sleep(.3); "
    stop += f"os.kill({os.getpid()}, signal.SIGCONT)"
    asked = []

    def from_first():
        if not asked:
            asked.append(subprocess.Popen([sys.executable, "-c", stop]))
        return True

    found = drive(arm, reach, Fixed(T), DriveSettings(late=0.03), start=HOME, running=from_first)
    asked[0].wait()
    assert found.end == DriveEnd.STOPPED and re.search(r"\d+ ms passed between two cycles", found.reason)
    arrays = found.log.arrays()
    assert arrays["log_braking"][-1] and np.abs(arrays["log_velocities_told"][-1]).max() < 2e-3
    first = int(np.argmax(arrays["log_braking"]))
    qdd = arrays["log_accelerations_told"][first:].astype(float)
    assert (np.abs(qdd) <= arm.limits.acceleration).all()
    assert np.abs(arm.read().qd).max() < 0.1
    arm.close()


def test_the_arm_s_own_kinematics_are_what_is_checked(franky):
    from jaxrmp._errors import ConfigurationError
    from jaxrmp.cli._arms import check_model, narrower
    from jaxrmp.kinematics import load_robot_from_string

    arm = FrankaArm(franky.host, "ignore")
    state = arm.read()
    assert check_model(arm, panda(), state) is None
    assert any("joint6 0.54" in line for line in narrower(arm, panda()))
    chain = "".join(
        f'<link name="l{k + 1}"/><joint name="j{k}" type="revolute"><origin xyz="0 0 0.1"/><parent link="l{k}"/>'
        f'<child link="l{k + 1}"/><axis xyz="0 {k % 2} {1 - k % 2}"/><limit lower="-3" upper="3" velocity="1" '
        'effort="1"/></joint>'
        for k in range(7)
    )
    other = load_robot_from_string(f'<robot name="other"><link name="l0"/>{chain}</robot>')
    with pytest.raises(ConfigurationError, match="no frame of 'other' is"):
        check_model(arm, other, state)
    arm.close()


def test_what_cannot_be_reached_or_is_not_ready_says_so(franky):
    with pytest.raises(ArmError, match=r"Is its cable in|realtime"):
        FrankaArm("127.0.0.77", "ignore")
    arm = FrankaArm(franky.host, "ignore")
    with pytest.raises(ArmError, match="no motion was started"):
        arm.send(np.zeros(7))
    arm.close()


# The command line, on a skill.


@pytest.fixture(scope="module")
def drawer(learned_drawer):
    return learned_drawer / "drawer_closing.skill.npz"


def jaxrmp(*arguments, **options):
    command = [sys.executable, "-m", "jaxrmp", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=400, check=False, **options)


def on(sim):
    return ("--robot", "franka", "--host", sim.host, "--realtime", "ignore", "--late", "0.5", "-q")


def test_a_skill_goes_from_start_to_goal_and_is_logged(strict, drawer, tmp_path):
    log, report = tmp_path / "drives", tmp_path / "drive.json"
    dry = jaxrmp("drive", drawer, *on(strict), "--dry-run")
    assert dry.returncode == 0 and "nothing is sent" in dry.stdout and "rests after" in dry.stdout
    away = jaxrmp("drive", drawer, *on(strict))
    assert away.returncode == 1 and "not at the start" in away.stderr and "--go" in away.stderr
    done = jaxrmp("drive", drawer, *on(strict), "--go", "--log", log, "--json", report)
    assert done.returncode == 0, done.stderr
    assert "came to rest" in done.stdout and not strict.violations
    found = json.loads(report.read_text())
    assert found["end"] == "rested" and found["goal_cm"] < 1.0 and found["energy_watched"]
    skill = learning.load_skill(drawer)
    arrays = np.load(log / "demo_0.npz")
    policy, robot = whole_arm_policy(skill, panda()), panda()
    q = arrays["joint_positions"]
    tree = policy.tree(jnp.asarray(np.asarray(skill.T_world_object)), World())
    kinematic = rollout(tree, jnp.asarray(arrays["log_positions_told"][0]), dt=0.002)

    def hand(path):
        return learning.control_points(robot, skill.frames, np.asarray(skill.offsets, float), path)[:, 0]

    expected = hand(np.asarray(kinematic.q, float))
    off = np.array([np.linalg.norm(expected - p, axis=1).min() for p in hand(q[::20])])
    assert off.max() < 0.01
    assert (log / "mcap" / "demo_0" / "demo_0.mcap").exists()


def driving(*arguments):
    """The command, in a process of its own, once it says that it drives; lines of progress tell."""
    command = [sys.executable, "-m", "jaxrmp", *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    said = []
    for line in process.stderr:
        said.append(line)
        if line.startswith("driving"):
            return process
    raise AssertionError(f"it did not drive: {said}")


FROM_HOME = "--start=" + ",".join(map(str, HOME))


def stopped_properly(file):
    arrays = np.load(file)
    assert arrays["log_braking"][-1] and not arrays["log_braking"][0]
    assert np.abs(arrays["log_velocities_told"][-1]).max() < 2e-3
    assert (np.abs(arrays["log_accelerations_told"]) <= 10.0).all()


def test_an_interrupt_brakes_and_keeps_the_log(franky, drawer, tmp_path):
    process = driving("drive", drawer, *on(franky)[:-1], FROM_HOME, "--log", tmp_path / "drives")
    time.sleep(1.5)
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, (out, err)
    assert "interrupted" in out
    stopped_properly(tmp_path / "drives" / "demo_0.npz")


def test_an_address_at_which_nobody_answers_can_be_given_up(tmp_path):
    with socket.create_server(("127.0.0.1", 1337)):  # the port of the interface; it says nothing
        command = ["record", "--robot", "franka", "--host", "127.0.0.1", "--realtime", "ignore"]
        command += ["--model", "panda", "--seconds", "1", "--out", str(tmp_path / "out")]
        process = subprocess.Popen([sys.executable, "-m", "jaxrmp", *command])
        time.sleep(8.0)  # by then it waits
        assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=20) == -signal.SIGTERM


def test_a_tracker_that_goes_silent_ends_it_with_a_reason(franky, tmp_path, drawer):
    T = np.asarray(learning.load_skill(drawer).T_world_object, float).tolist()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    silent = threading.Event()

    def track():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not silent.is_set():
                out.sendto(json.dumps({"T_world_object": T}).encode(), ("127.0.0.1", port))
                time.sleep(1 / 30)

    tracker = threading.Thread(target=track, daemon=True)
    tracker.start()
    tracked = ("--tracker", f"udp:{port}", "--keep", "0.4", "--log", tmp_path / "drives")
    process = driving("drive", drawer, *on(franky)[:-1], FROM_HOME, *tracked)
    time.sleep(1.0)
    silent.set()
    out, err = process.communicate(timeout=120)
    tracker.join()
    assert process.returncode == 1, (out, err)
    assert "tracker is silent" in err
    stopped_properly(tmp_path / "drives" / "demo_0.npz")


def test_demonstrations_are_recorded_from_an_arm_that_is_guided(tmp_path_factory, tmp_path):
    with started("franky-sim", tmp_path_factory, script=GUIDED) as sim:
        folder = tmp_path / "demos"
        for _ in range(2):
            done = jaxrmp("record", "--host", sim.host, "--realtime", "ignore", "--out", folder, "--seconds", "3")
            assert done.returncode == 0, done.stderr
        by_hand = ["record", "--host", sim.host, "--realtime", "ignore", "--out", str(folder), "--stdin"]
        process = subprocess.Popen(
            [sys.executable, "-m", "jaxrmp", *by_hand], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert "Enter begins" in process.stdout.readline()
        for said, seconds in (("\n", 3.0), ("\nq\n", 0.0)):
            process.stdin.write(said)
            process.stdin.flush()
            time.sleep(seconds)
        assert process.wait(timeout=60) == 0
        arm = FrankaArm(sim.host, "ignore")
        calls = iter(range(1000))
        found = record(arm, lambda: next(calls) < 500, rate=200.0)
        arm.close()
    assert found["time"][-1] > 0.3 and len(found["time"]) >= 50
    demos = learning.load_demonstrations(folder)
    assert len(list((folder / "mcap").iterdir())) == 3
    assert len(demos) == 3 and demos.joint_names == NAMES
    for demonstration in list(demos)[:2]:
        rate = (len(demonstration.time) - 1) / demonstration.time[-1]
        assert 20 < rate < 110 and demonstration.time[-1] > 0.5
        assert np.ptp(demonstration.q[:, 0]) > 0.02 and np.ptp(demonstration.q[:, 1]) < 0.02
