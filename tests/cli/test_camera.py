"""`jaxrmp calibrate` and `jaxrmp track`, on rendered depth images in files."""

import csv
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from jaxrmp.cli import main
from jaxrmp.perception import KINECT, depth_renderer, frames_writer, measured_depth, open_frames

from ..perception import conftest as cabinet
from ..perception import posed


def write(path, depths, eye, q=None, posed=False, still=1.0):
    T = eye.T_world_camera if posed else None
    with frames_writer(path, [*eye.focal, *eye.middle], T_world_camera=T) as add:
        for k, depth in enumerate(depths):
            add(depth, k * still, None if q is None else q[k])


def rpy(R):
    return np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0])


@pytest.fixture(scope="module")
def postures(tmp_path_factory, can_draw):
    """A folder with a robot and its images in five postures, each for a second; and the camera."""
    if not can_draw:
        pytest.skip("needs OSMesa or a display")
    folder = tmp_path_factory.mktemp("postures")
    (folder / "robot.xml").write_text(posed.ARM)
    eye = posed.camera()
    write(folder / "postures.npz", posed.images(posed.ARM, posed.POSTURES, eye), eye, posed.POSTURES, still=100.0)
    return folder, eye


def test_a_camera_is_found_and_written_as_toml_and_with_its_frames(postures, tmp_path, capsys):
    folder, eye = postures
    T = eye.T_world_camera
    guess = ",".join(map(str, [*(T[:3, 3] + [0.02, -0.02, 0.01]), *(np.array(rpy(T[:3, :3])) + [0.05, -0.05, 0.05])]))
    common = [str(folder / "postures.npz"), "--robot", str(folder / "robot.xml"), f"--guess={guess}"]
    assert main(["calibrate", *common, "--out", str(tmp_path / "camera.toml")]) == 0
    said = capsys.readouterr().out
    assert "5 of 5 images show the robot" in said and "standard deviations" in said
    assert main(["calibrate", *common, "--out", str(tmp_path / "posed.npz")]) == 0
    frames = open_frames(tmp_path / "posed.npz")
    off = np.linalg.inv(T) @ frames.camera.T_world_camera
    assert frames.posed and np.linalg.norm(off[:3, 3]) < 0.003
    np.testing.assert_array_equal(list(frames.raw()), list(open_frames(folder / "postures.npz").raw()))
    from jaxrmp.cli._poses import pose_named

    np.testing.assert_allclose(pose_named(str(tmp_path / "camera.toml"), "--camera"), frames.camera.T_world_camera)


@pytest.fixture(scope="module")
def watched(tmp_path_factory, can_draw):
    """A folder with a cabinet and 20 images of it, hidden from 10 to 13; the camera's pose is not in them."""
    if not can_draw:
        pytest.skip("needs OSMesa or a display")
    folder = tmp_path_factory.mktemp("watched")
    (folder / "cabinet.xml").write_text(cabinet.MODEL)
    m, data = cabinet.model_and_data()
    eye, rng, depths = cabinet.camera(), np.random.default_rng(0), []
    with depth_renderer(m, eye.width, eye.height) as render:
        for k in range(20):
            cabinet.put(m, data, 0.5 + 0.01 * k, 0.08)
            depth = measured_depth(KINECT, render(data, eye), rng)
            depths.append(np.where(10 <= k < 13, 0.5, depth).astype(np.float32))
    write(folder / "frames.npz", depths, eye, still=1 / 30)
    np.savetxt(folder / "camera.txt", eye.T_world_camera)
    return folder


def command(folder, out):
    words = ["track", str(folder / "frames.npz"), "--object", f"{folder / 'cabinet.xml'}:object"]
    words += ["--guess=0.12,-0.06,0.41", "--joints=0.4,0.05", "--camera", str(folder / "camera.txt")]
    return [*words, "--out", out]


def test_an_object_is_followed_and_written_with_what_was_lost_marked(watched, tmp_path, capsys):
    assert main(command(watched, str(tmp_path / "found.npz"))) == 0
    assert "20 images" in (said := capsys.readouterr().out) and "found again 1 time," in said and "ms an image" in said
    found = np.load(tmp_path / "found.npz")
    assert found["lost"][10:13].all() and not found["lost"][5:10].any() and not found["lost"][16:].any()
    assert all(np.isfinite(found[name]).all() for name in ("T_world_object", "q", "qd", "covariance", "time"))
    assert np.linalg.norm(found["T_world_object"][9][:3, 3] - cabinet.T_WORLD_OBJECT[:3, 3]) < 0.004
    assert abs(found["q"][9][0] - 0.59) < 0.02 and list(found["joint_names"]) == ["hinge", "slide"]
    assert main(command(watched, str(tmp_path / "found.csv"))) == 0
    with (tmp_path / "found.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["lost"]) for row in rows] == found["lost"].astype(int).tolist()
    assert float(rows[9]["hinge"]) == pytest.approx(found["q"][9][0], abs=1e-3)
    assert float(rows[9]["sigma_hinge"]) > 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"--camera": None}, "has no T_world_camera"),
        ({"--guess": "1,2"}, "expected 3 or 6 numbers"),
        ({"--guess": "here"}, "x,y,z,roll,pitch,yaw"),
        ({"--object": "none.xml"}, "no such file"),
        ({"--joints": "0.1"}, "object 2 joints"),
        ({"--joints": "nan,0.1"}, "hinge is nan, and goes from"),
        ({"--joints": "0.1,30"}, "slide is 30, and goes from"),
        ({"--out": "found.txt"}, "expected a .npz or a .csv"),
        ({"--robot": "panda"}, "has no q"),
        ({"FRAMES": "none.npz"}, "is not there"),
    ],
)
def test_what_does_not_fit_is_told(watched, tmp_path, capsys, change, said):
    given = {
        "FRAMES": str(watched / "frames.npz"),
        "--object": f"{watched / 'cabinet.xml'}:object",
        "--guess": "0,0,0",
        "--camera": str(watched / "camera.txt"),
        "--out": str(tmp_path / "found.npz"),
    } | change
    words = [given.pop("FRAMES"), *(f"{name}={value}" for name, value in given.items() if value is not None)]
    assert main(["track", *words]) == 1
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("images", "apart", "told"),
    [(1, 5.0, True), (2, 5.0, False), (30, 5.0, False)],  # of each posture, s from one to the next, and a warning
)
def test_images_in_which_the_robot_stands_still_are_chosen_one_of_each_posture(images, apart, told, capsys):
    from jaxrmp.cli._calibrate import _postures

    q = np.repeat(posed.POSTURES, images, axis=0)
    time = np.concatenate([k * apart + np.arange(images) / 30 for k in range(len(posed.POSTURES))])
    chosen = _postures(time, q, 10)
    assert [k // images for k in chosen] == list(range(len(posed.POSTURES)))
    assert ("stands still" in capsys.readouterr().err) == told


def test_while_it_moves_the_robot_is_left_out_and_one_posture_is_taken_once():
    from jaxrmp.cli._calibrate import _postures

    ways = [np.linspace(a, b, 30) for a, b in zip(posed.POSTURES[:-1], posed.POSTURES[1:], strict=True)]
    rests = [np.repeat(p[None], 30, axis=0) for p in posed.POSTURES]
    q = np.concatenate([part for pair in zip(rests, ways, strict=False) for part in pair] + rests[-1:])
    chosen = _postures(np.arange(len(q)) / 30, q, 10)
    assert len(chosen) == len(posed.POSTURES) and all(np.abs(posed.POSTURES - q[k]).sum(1).min() < 1e-9 for k in chosen)
    assert _postures(np.arange(3.0), np.zeros((3, 2)), 10) == [0]


def test_joints_in_degrees_are_told(tmp_path, capsys):
    from jaxrmp.cli._poses import check_joints, robot_named

    check_joints(np.full((1, 7), -90.0), robot_named("panda"), tmp_path)
    assert "joints are in rad" in capsys.readouterr().err


def test_joints_of_another_robot_and_a_camera_without_a_guess_are_told(postures, tmp_path, capsys):
    folder, _ = postures
    words = ["calibrate", str(folder / "postures.npz"), "--robot"]
    out = ["--out", str(tmp_path / "camera.toml")]
    assert main([*words, str(folder / "robot.xml"), *out]) == 1
    assert "say with --guess" in capsys.readouterr().err
    assert main([*words, "panda", "--guess=0,0,1", *out]) == 1
    assert "3 joints an image, and 'panda' has 7" in capsys.readouterr().err
    assert main([*words, "panda", "--guess=0,0,1", "--out", str(tmp_path / "camera.txt")]) == 1
    assert "expected a .toml" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("which", ["track", "calibrate"])
def test_an_interrupt_ends_at_once_and_leaves_no_file(watched, postures, tmp_path, which):
    out = tmp_path / "out"
    out.mkdir()
    words = command(watched, str(out / "found.npz"))
    if which == "calibrate":
        folder, _ = postures
        words = ["calibrate", str(folder / "postures.npz"), "--robot", str(folder / "robot.xml"), "--guess=0.7,0.5,0.6"]
        words += ["--out", str(out / "camera.toml")]
    # Without compiled programs at hand, so that it is compiling when it is interrupted.
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(tmp_path / "cache")}
    program = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    program += "from jaxrmp.cli import main; sys.exit(main())"
    process = subprocess.Popen(
        [sys.executable, "-c", program, *words], stderr=subprocess.PIPE, text=True, env=environment
    )
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith(("images", "camera", "model", "robot")):
            break
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    rest = process.stderr.read()
    assert process.wait(timeout=60) == 130
    assert "interrupted" in rest and "Traceback" not in rest
    assert list(out.iterdir()) == []
