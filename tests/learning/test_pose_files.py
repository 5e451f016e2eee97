"""Poses of a hand and planar paths, as files have them: units and quaternions that nothing says, signs that flip."""

import json

import numpy as np
import pytest
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from jaxrmp import DemonstrationError, FileWarning, RigidTransformError
from jaxrmp.learning import (
    PoseDemonstration,
    PoseDemonstrationSet,
    RecordingSettings,
    is_paths,
    is_poses,
    load_demonstrations,
    load_paths,
    load_poses,
)

T = 30
TIME = np.linspace(0, 2, T)
POSITION = np.linspace([0.4, 0, 0.3], [0.5, 0.2, 0.1], T)
TURN = Rotation.from_rotvec(np.linspace([0, 0, 0.1], [0, 0, 5.0], T))  # past half a turn
XYZW = TURN.as_quat() * np.where(np.arange(T) % 7 > 3, -1, 1)[:, None]  # with flips
WXYZ = np.roll(XYZW, 1, axis=1)
SAID = RecordingSettings(units="cm", quaternion="xyzw")


def check(found, count=2):
    assert isinstance(found, PoseDemonstrationSet) and len(found) == count
    for demonstration in found:
        np.testing.assert_allclose(demonstration.position, POSITION, atol=1e-12)
        np.testing.assert_allclose(demonstration.hand[:, :3, :3], TURN.as_matrix(), atol=1e-9)
        assert (np.sum(demonstration.quaternion[1:] * demonstration.quaternion[:-1], axis=1) > 0.9).all()
        assert demonstration.quaternion[0] @ found[0].quaternion[0] > 0


def test_one_file_without_time_unit_and_order(tmp_path):
    """As the boxes opened and the glasses poured that people compare with."""
    file = tmp_path / "pouring.npz"
    arrays = {f"positions_{k}": 100 * POSITION for k in (0, 2, 10)} | {
        f"quaternions_{k}": (1 - k % 4) * XYZW for k in (0, 2, 10)
    }
    np.savez(file, **arrays)
    with pytest.warns(FileWarning, match="there is no time: samples are taken 100 a second. recording.rate says"):
        check(load_poses(file, SAID), 3)
    found = load_poses(file, RecordingSettings(units="cm", quaternion="xyzw", rate=15, episodes=(0, 10)))
    check(found)
    assert found[0].time[-1] == 29 / 15
    with pytest.raises(
        DemonstrationError, match=r"nothing says the units .*coordinate is 50\)\. Say --units .* m or cm or mm"
    ):
        load_poses(file, RecordingSettings(quaternion="xyzw"))
    everything = (
        r"(?s)\[poses\].* nothing says the units .*Say --units .* And nothing says the quaternion .*wxyz or xyzw"
    )
    with pytest.raises(DemonstrationError, match=everything):
        load_demonstrations(file)
    with pytest.raises(DemonstrationError, match=r"units 'degrees' cannot be of these recordings"):
        load_poses(file, RecordingSettings(units="degrees", quaternion="xyzw"))
    with pytest.raises(
        DemonstrationError, match=r"nothing says the quaternion .*\(recording.quaternion\) wxyz or xyzw"
    ):
        load_poses(file, RecordingSettings(units="cm", rate=10))
    with pytest.raises(DemonstrationError, match=r"(?s)holds poses of a hand and no joints\. .*\[poses\].*load_poses"):
        load_demonstrations(file)


def test_a_folder_says_its_units_and_order_in_meta(tmp_path):
    T_base_box = np.eye(4)
    T_base_box[:3, 3] = [100, 0, 0]
    for k in range(2):
        arrays = {"positions": 1000 * POSITION, "quaternions": XYZW, "time": TIME, "pose_base_box": T_base_box}
        np.savez(tmp_path / f"demo_{k}.npz", **arrays)
    (tmp_path / "meta.json").write_text(json.dumps({"units": "mm", "quaternion": "xyzw"}))
    found = load_poses(tmp_path)
    check(found)
    np.testing.assert_allclose(found[1].poses["box"][:3, 3], [0.1, 0, 0])
    np.testing.assert_array_equal(found[0].time, TIME)


def test_tables_say_the_order_by_their_columns(tmp_path):
    columns = ["time", "qx", "qy", "qz", "qw", "x", "y", "z"]
    table = np.c_[TIME, XYZW, POSITION]
    for k in range(2):
        np.savetxt(tmp_path / f"demo_{k}.csv", table, delimiter=",", header=",".join(columns), comments="")
    check(load_poses(tmp_path, RecordingSettings(units="m")))
    with pytest.raises(DemonstrationError, match="holds poses of a hand and no joints"):
        load_demonstrations(tmp_path)
    (tmp_path / "demo_1.csv").write_text("time,x,y,z\n0,1,2,3\n")
    with pytest.raises(DemonstrationError, match=r"demo_1.csv has the columns .*'qw' is missing"):
        load_poses(tmp_path, RecordingSettings(units="m"))


def test_joints_with_the_hands_pose_beside_them_are_joints(tmp_path):
    """And a damaged file is neither poses nor paths."""
    table, header = np.c_[TIME, TIME, -TIME, POSITION, WXYZ], "time,a,b,x,y,z,qw,qx,qy,qz"
    arrays = {"time": TIME, "joint_positions": table[:, 1:3], "position": POSITION, "quaternion": WXYZ}
    for folder in (tmp_path / "tables", tmp_path / "arrays"):
        folder.mkdir()
    for k in range(2):
        np.savetxt(tmp_path / "tables" / f"demo_{k}.csv", table, delimiter=",", header=header, comments="")
        np.savez(tmp_path / "arrays" / f"demo_{k}.npz", **arrays)
    (tmp_path / "arrays" / "meta.json").write_text(json.dumps({"robot": "arm", "joint_names": ["a", "b"]}))
    assert load_demonstrations(tmp_path / "tables").joint_names[:2] == ("a", "b")
    with pytest.warns(FileWarning, match=r"arrays \['position', 'quaternion'\] of demo_0.npz are not read"):
        np.testing.assert_array_equal(load_demonstrations(tmp_path / "arrays")[1].q, table[:, 1:3])
    file = tmp_path / "poses.npz"
    np.savez(file, positions_0=POSITION, quaternions_0=WXYZ)
    for cut in (0, 40, 900):
        (tmp_path / "cut.npz").write_bytes(file.read_bytes()[:cut])
        assert is_poses(file) and not is_poses(tmp_path / "cut.npz") and not is_paths(tmp_path / "cut.npz")


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"quaternion": 2 * WXYZ}, RigidTransformError, "quaternion at sample 0 has length 2, expected 1"),
        ({"position": POSITION[:9]}, DemonstrationError, r"positions have shape \(9, 3\)"),
        (
            {"position": POSITION * np.nan},
            DemonstrationError,
            "the hand: position and quaternion not finite at sample 0",
        ),
        ({"time": TIME[::-1]}, DemonstrationError, "time runs backwards at sample 1"),
        ({"position": "here"}, DemonstrationError, "not arrays of numbers"),
        ({"poses": {"box": 2 * np.eye(4)}}, RigidTransformError, "the pose of 'box'"),
    ],
)
def test_poses_that_are_none(change, error, message):
    with pytest.raises(error, match=message):
        PoseDemonstration(**({"time": TIME, "position": POSITION, "quaternion": WXYZ} | change))


def test_one_pose_demonstration_is_not_enough_and_arrays_are_kept():
    one = PoseDemonstration(TIME, POSITION, WXYZ)
    with pytest.raises(ValueError, match="read-only"):
        one.quaternion[0] = 0
    with pytest.raises(DemonstrationError, match=r"received 1 demonstration.*at least two"):
        PoseDemonstrationSet((one,))


@pytest.mark.recordings
@pytest.mark.parametrize("task", ["openbox", "pouring"])
def test_published_poses_end_at_one_place(recordings, task):
    settings = RecordingSettings(units="cm", quaternion="wxyz", rate=100)
    found = load_poses(recordings.parent / "poses" / f"{task}.npz", settings)
    ends = np.stack([d.position[-1] for d in found])
    assert len(found) == 9 and np.ptp(ends, axis=0).max() < 0.01


def test_planar_paths_from_archives_tables_and_lasa(tmp_path):
    path = POSITION[:, :2]
    np.savez(tmp_path / "e.npz", **{f"positions_{k}": k + path for k in (10, 2, 1)}, scale=np.ones(1))
    assert [p[0, 1] for p in load_paths(tmp_path / "e.npz")] == [1, 2, 10]
    lasa = {"pos": path.T, "vel": path.T, "t": TIME[None], "dt": 0.1}
    cells = np.empty((1, 2), object)
    cells[0, 0], cells[0, 1] = lasa, lasa
    savemat(tmp_path / "S.mat", {"demos": cells, "dt": 0.1, "name": "S"})
    for found in load_paths(tmp_path / "S.mat"):
        np.testing.assert_array_equal(found, path)
    for k in (0, 1):
        np.savetxt(tmp_path / f"path_{k}.csv", np.c_[TIME, path], delimiter=",", header="time,x,y", comments="")
    np.testing.assert_array_equal(load_paths(tmp_path)[1], path)
    with pytest.raises(DemonstrationError, match=r"of no kind that is known\. .*a folder of \.csv files"):
        load_paths(tmp_path / "path_0.csv")
    np.savez(tmp_path / "flat.npz", positions_0=POSITION, positions_1=POSITION)
    with pytest.raises(DemonstrationError, match=r"positions_0 has shape \(30, 3\), expected \[T, 2\]"):
        load_paths(tmp_path / "flat.npz")
    (tmp_path / "a.txt").write_text("")
    with pytest.raises(DemonstrationError, match=r"of no kind that is known\. Expected"):
        load_paths(tmp_path / "a.txt")
