"""Depth images in files: what is written is read, and what is missing or odd is named."""

import numpy as np
import pytest

from jaxrmp import FramesError
from jaxrmp.perception import frames_writer, open_frames

INTRINSICS = [300.0, 310.0, 9.5, 7.5]
DEPTH = np.random.default_rng(0).uniform(0.5, 2, (5, 16, 20)).astype(np.float32)
GOOD = {"depth": DEPTH, "intrinsics": INTRINSICS, "time": np.arange(5) / 30}


def test_floats_come_back_with_pose_and_joints(tmp_path):
    T = np.eye(4)
    T[:3, 3] = 0.1, 0.2, 0.3
    with frames_writer(tmp_path / "f.npz", INTRINSICS, T_world_camera=T) as add:
        for k in range(5):
            add(DEPTH[k], k / 30, [0.1 * k, 1.0])
    frames = open_frames(tmp_path / "f.npz")
    assert len(frames) == 5 and frames.posed and (frames.camera.width, frames.camera.height) == (20, 16)
    np.testing.assert_array_equal(np.stack(list(frames.depths())), DEPTH)
    np.testing.assert_allclose(frames.camera.T_world_camera, T)
    np.testing.assert_allclose(frames.camera.focal, INTRINSICS[:2])
    np.testing.assert_allclose(frames.time, GOOD["time"])
    assert frames.q is not None and frames.q[3].tolist() == [0.1 * 3, 1.0]
    np.testing.assert_array_equal(np.load(tmp_path / "f.npz")["depth"], DEPTH)  # for NumPy it is an NPZ as any
    assert [p.name for p in tmp_path.iterdir()] == ["f.npz"]


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_millimetres_of_numpys_own_files_come_as_metres(tmp_path, save):
    save(tmp_path / "f.npz", **GOOD | {"depth": np.round(1000 * DEPTH).astype(np.uint16)}, depth_scale=0.001)
    frames = open_frames(tmp_path / "f.npz")
    assert not frames.posed and frames.q is None
    np.testing.assert_allclose(np.stack(list(frames.depths())), DEPTH, atol=5.1e-4)


def test_what_was_not_measured_is_zero(tmp_path):
    depth = DEPTH.copy()
    depth[0, 0, :3] = np.nan, np.inf, -1
    np.savez(tmp_path / "f.npz", **GOOD | {"depth": depth})
    assert next(open_frames(tmp_path / "f.npz").depths())[0, :4].tolist() == [0, 0, 0, depth[0, 0, 3]]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"depth": None}, "no 'depth'"),
        ({"intrinsics": None}, "no 'intrinsics'"),
        ({"time": None}, "no 'time'"),
        ({"depth": DEPTH[0]}, "expected \\[T, height, width\\]"),
        ({"depth": DEPTH.astype(complex)}, "expected floats, m, or unsigned"),
        ({"depth": DEPTH.astype(np.uint16)}, "no depth_scale"),
        ({"depth": DEPTH.astype(np.uint16), "depth_scale": -1.0}, "positive"),
        ({"depth_scale": 0.001}, "leave it out"),
        ({"depth": np.asfortranarray(DEPTH)}, "ascontiguousarray"),
        ({"intrinsics": np.eye(3)}, "fx, fy, cx, cy"),
        ({"intrinsics": [300.0, np.nan, 1.0, 1.0]}, "intrinsics holds what is not finite"),
        ({"intrinsics": [-300.0, 300.0, 1.0, 1.0]}, "focal"),
        ({"time": np.arange(4.0)}, "time has shape"),
        ({"time": np.array([0.0, 1.0, 0.5, 2.0, 3.0])}, "does not rise from image 1"),
        ({"time": np.array(["a"] * 5)}, "expected numbers"),
        ({"q": np.zeros(5)}, "q has shape"),
        ({"q": np.full((5, 2), np.nan)}, "q holds what is not finite"),
        ({"T_world_camera": np.eye(3)}, "T_world_camera has shape"),
        ({"T_world_camera": 2 * np.eye(4)}, "T_world_camera"),
    ],
)
def test_what_is_missing_or_odd_is_named(tmp_path, change, said):
    content = {name: value for name, value in (GOOD | change).items() if value is not None}
    np.savez(tmp_path / "f.npz", **content)
    with pytest.raises(FramesError, match=said):
        open_frames(tmp_path / "f.npz")


@pytest.mark.parametrize(("depth", "scale"), [(1000 * DEPTH, None), ((1000 * DEPTH).astype(np.uint16), 1.0)])
def test_depths_that_look_like_millimetres_are_refused(tmp_path, depth, scale):
    np.savez(tmp_path / "f.npz", **GOOD | {"depth": depth}, **({} if scale is None else {"depth_scale": scale}))
    with pytest.raises(FramesError, match=r"0\.001 for millimetres"):
        next(open_frames(tmp_path / "f.npz").depths())


def test_an_empty_first_image_does_not_hide_another_unit(tmp_path):
    np.savez(tmp_path / "f.npz", **GOOD | {"depth": np.concatenate([0 * DEPTH[:1], 1000 * DEPTH[1:]])})
    with pytest.raises(FramesError, match=r"0\.001 for millimetres"):
        list(open_frames(tmp_path / "f.npz").depths())


def test_files_that_are_none_or_cut_short_are_named(tmp_path):
    with pytest.raises(FramesError, match="is not there"):
        open_frames(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(FramesError, match="cannot be read as NPZ"):
        open_frames(tmp_path / "text.npz")
    np.savez_compressed(tmp_path / "f.npz", **GOOD)
    content = bytearray((tmp_path / "f.npz").read_bytes())
    content[2000:3000] = bytes(1000)
    (tmp_path / "f.npz").write_bytes(content)
    with pytest.raises(FramesError, match="cannot be read"):
        list(open_frames(tmp_path / "f.npz").depths())


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_what_came_before_a_recording_failed_is_kept(tmp_path, error):
    def record():
        with frames_writer(tmp_path / "f.npz", INTRINSICS) as add:
            add(DEPTH[0], 0.0, [1.0])
            with pytest.raises(FramesError, match="image 1 is of"):
                add(DEPTH[1], -1.0, [2.0])
            add(DEPTH[1], 1.0, [3.0])
            raise error

    with pytest.raises(error):
        record()
    frames = open_frames(tmp_path / "f.npz")
    np.testing.assert_array_equal(np.stack(list(frames.raw())), DEPTH[:2].astype(np.float32))
    assert frames.time.tolist() == [0.0, 1.0]
    assert frames.q.tolist() == [[1.0], [3.0]]
    assert [f.name for f in tmp_path.iterdir()] == ["f.npz"]


def test_an_interrupted_writer_without_images_leaves_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), frames_writer(tmp_path / "f.npz", INTRINSICS):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_images_that_do_not_fit_are_named(tmp_path):
    def write(*images, **given):
        with frames_writer(tmp_path / "f.npz", INTRINSICS, **given) as add:
            for image in images:
                add(*image)

    for images, said in (
        ([], "no image"),
        ([(DEPTH, 0.0)], "expected \\[height, width\\]"),
        ([(DEPTH[0].astype(np.uint16), 0.0)], "depth_scale"),
        ([(DEPTH[0], 0.0), (DEPTH[0, 1:], 1.0)], "after those of"),
        ([(DEPTH[0], 0.0), (DEPTH[1], 0.0)], "image 1 is of 0.0 s"),
        ([(DEPTH[0], 0.0, [1.0]), (DEPTH[1], 1.0)], "q is given"),
        ([(DEPTH[0], 0.0, [np.nan])], "q of image 0"),
    ):
        with pytest.raises(FramesError, match=said):
            write(*images)
        kept = list(tmp_path.iterdir())
        assert len(kept) == (len(images) == 2)  # the first, that is whole
        for file in kept:
            assert len(open_frames(file)) == 1
            file.unlink()


@pytest.mark.parametrize(
    ("intrinsics", "given", "said"),
    [
        (np.eye(3), {}, "intrinsics has shape"),
        ([np.nan] * 4, {}, "expected finite"),
        ([-1.0, 1.0, 1.0, 1.0], {}, "focal"),
        (INTRINSICS, {"T_world_camera": np.full((4, 4), np.nan)}, "T_world_camera"),
        (INTRINSICS, {"T_world_camera": [1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0]}, "T_world_camera has shape"),
        (INTRINSICS, {"depth_scale": 0.0}, "depth_scale is 0"),
    ],
)
def test_a_writer_refuses_at_once_what_could_not_be_read(tmp_path, intrinsics, given, said):
    with pytest.raises(FramesError, match=said), frames_writer(tmp_path / "f.npz", intrinsics, **given):
        pytest.fail("images would be taken in vain")
    assert list(tmp_path.iterdir()) == []
