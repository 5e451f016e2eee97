"""`jaxrmp drive`, with an arm in MuJoCo."""

import json
import socket
import threading

import numpy as np
import pytest

from jaxrmp.cli import main
from jaxrmp.learning import load_demonstrations


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
