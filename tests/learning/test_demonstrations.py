"""Demonstration sets, and the folders they are read from and written to."""

import json

import numpy as np
import pytest

from jaxrmp import DemonstrationError, FileWarning, RigidTransformError, UnknownNameError
from jaxrmp.learning import load_demonstrations, save_demonstrations
from jaxrmp.learning._demonstrations import Demonstration, DemonstrationSet

JOINTS = ("a", "b", "c")


def rotation_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0, 0.1], [s, c, 0.0, 0.2], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.0, 1.0]])


def demonstration(samples=20, seed=0, **changes):
    rng = np.random.default_rng(seed)
    parts = {"time": np.arange(samples) / 30, "q": np.cumsum(rng.normal(size=(samples, 3)), axis=0), "poses": {}}
    return Demonstration(**(parts | changes))


def demonstration_set(*demonstrations):
    return DemonstrationSet(demonstrations or (demonstration(), demonstration(seed=1)), JOINTS, "arm", "test")


def changed(values, sample, value):
    values = np.array(values)
    values[sample] = value
    return values


@pytest.fixture
def folder(tmp_path):
    """A folder of two demonstrations with a tracked box."""
    poses = {"box": np.stack([rotation_z(0.01 * t) for t in range(20)]), "table": rotation_z(1.0)}
    return save_demonstrations(
        demonstration_set(demonstration(poses=poses), demonstration(seed=1, poses=poses)), tmp_path / "demos"
    )


def rewrite(file, **changes):
    with np.load(file) as archive:
        arrays = dict(archive)
    for key, value in changes.items():
        if value is None:
            del arrays[key]
        else:
            arrays[key] = value
    np.savez(file, **arrays)


def rewrite_meta(folder, **changes):
    meta = json.loads((folder / "meta.json").read_text()) | changes
    (folder / "meta.json").write_text(json.dumps({key: value for key, value in meta.items() if value is not None}))


def test_a_set_is_a_sequence_of_read_only_demonstrations():
    demonstrations = demonstration_set()
    assert len(demonstrations) == len(list(demonstrations)) == 2
    with pytest.raises(ValueError, match="read-only"):
        demonstrations[0].q[0] = 0.0


def test_repeated_stamps_are_allowed():
    demonstration_set(demonstration(time=np.repeat(np.arange(10) / 30, 2)), demonstration())


def test_pose_of_a_tracked_and_of_a_resting_object():
    tracked = np.stack([rotation_z(0.1 * t) for t in range(20)])
    d = demonstration(poses={"box": tracked, "table": rotation_z(1.0)})
    np.testing.assert_array_equal(d.pose("box", 3), rotation_z(0.1 * 3))
    np.testing.assert_array_equal(d.pose("table", 3), rotation_z(1.0))
    with pytest.raises(UnknownNameError, match="Did you mean 'table'"):
        d.pose("tabel")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"q": np.zeros((20, 4))}, r"demonstration 1: joint positions have shape \(20, 4\), expected \[T, 3\]"),
        ({"q": np.zeros(20)}, "joint positions have shape"),
        ({"time": np.arange(19) / 30}, r"time has shape \(19,\) but there are 20 rows"),
        ({"time": np.zeros(1), "q": np.zeros((1, 3))}, "at least two"),
        ({"q": changed(np.zeros((20, 3)), 7, np.nan)}, "demonstration 1: joint positions not finite at sample 7"),
        ({"time": changed(np.arange(20) / 30, 4, np.inf)}, "time not finite at sample 4"),
        ({"time": changed(np.arange(20) / 30, 9, 0.0)}, r"demonstration 1: time runs backwards at sample 9, from 0.26"),
        ({"poses": {"box": rotation_z(0.0)}}, "demonstration 1 has the objects .*demonstration 0 has"),
        ({"poses": {"box": np.zeros((5, 4, 4))}}, r"pose of 'box' has shape \(5, 4, 4\), expected"),
    ],
)
def test_an_unfit_demonstration_is_named(changes, message):
    with pytest.raises(DemonstrationError, match=message):
        demonstration_set(demonstration(), demonstration(**changes))


def test_one_demonstration_is_not_enough():
    with pytest.raises(DemonstrationError, match=r"received 1 demonstration.*at least"):
        demonstration_set(demonstration())


@pytest.mark.parametrize("value", [[[0.0, 1.0], [2.0]], "time", [object()]])
def test_what_is_no_array_of_numbers_is_refused(value):
    with pytest.raises(DemonstrationError, match="q is not an array of numbers"):
        demonstration(q=value)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda T: 2 * T, "last row"),
        (lambda T: T * [[1.1], [1], [1], [1]], "not orthonormal"),
        (lambda T: T * [[-1], [1], [1], [1]], "reflection"),
        (lambda T: T * np.nan, "non-finite"),
    ],
)
def test_a_pose_that_is_not_rigid_is_named_with_its_sample(spoil, message):
    poses = np.stack([rotation_z(0.01 * t) for t in range(20)])
    poses[5] = spoil(poses[5])
    good = demonstration(poses={"box": rotation_z(0.0)})
    with pytest.raises(RigidTransformError, match=f"demonstration 1: the pose of 'box' at sample 5.*{message}"):
        demonstration_set(good, demonstration(poses={"box": poses}))


def test_saved_and_loaded_sets_are_equal(folder):
    first, again = load_demonstrations(folder), folder.parent / "again"
    second = load_demonstrations(save_demonstrations(first, again))
    assert (second.joint_names, second.robot, second.source) == (JOINTS, "arm", "test")
    assert second.object_names == ("box", "table")
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.q, b.q)
        np.testing.assert_array_equal(a.time, b.time)
        np.testing.assert_array_equal(a.poses["box"], b.poses["box"])
        np.testing.assert_array_equal(a.poses["table"], b.poses["table"])


def test_objects_are_brought_into_the_base_frame(folder):
    T_world_base = rotation_z(0.7)
    with np.load(folder / "demo_0.npz") as archive:
        T_base_box = archive["pose_world_box"]
    rewrite(
        folder / "demo_0.npz",
        pose_world_base=np.tile(T_world_base, (20, 1, 1)),
        pose_world_box=T_world_base @ T_base_box,
    )
    np.testing.assert_allclose(load_demonstrations(folder)[0].poses["box"], T_base_box, atol=1e-15)


def test_files_come_in_the_order_of_their_numbers(tmp_path):
    many = tuple(demonstration(seed=k) for k in range(12))
    loaded = load_demonstrations(save_demonstrations(demonstration_set(*many), tmp_path / "many"))
    for a, b in zip(loaded, many, strict=True):
        np.testing.assert_array_equal(a.q, b.q)


@pytest.mark.parametrize(
    ("spoil", "error", "message"),
    [
        (lambda f: (f / "meta.json").unlink(), DemonstrationError, "meta.json is missing"),
        (lambda f: (f / "meta.json").write_text("{"), DemonstrationError, "meta.json is not readable as JSON"),
        (lambda f: (f / "meta.json").write_bytes(b"\xff\xfe\x00"), DemonstrationError, "not readable as JSON"),
        (lambda f: (f / "meta.json").write_text("[]"), DemonstrationError, "holds a list, expected a JSON object"),
        (lambda f: rewrite_meta(f, joint_names="a"), DemonstrationError, "joint_names is 'a', expected a list"),
        (lambda f: rewrite_meta(f, joint_names=None), DemonstrationError, "has no 'joint_names'"),
        (lambda f: rewrite_meta(f, robot=None), DemonstrationError, "has no 'robot'"),
        (lambda f: rewrite_meta(f, joint_names=["a"]), DemonstrationError, r"demo_0.npz: joint.*expected \[T, 1\]"),
        (
            lambda f: rewrite_meta(f, units={"joints": "deg"}),
            DemonstrationError,
            "units are said of 'joints'; known are",
        ),
        (lambda f: rewrite_meta(f, units={"time": "ms"}), DemonstrationError, "units of 'time' are 'ms', but only s"),
        (lambda f: rewrite_meta(f, units={"pose": "mm"}), DemonstrationError, "units of 'pose' are 'mm', but only m"),
        (lambda f: rewrite_meta(f, units=["deg"]), DemonstrationError, r"units is \['deg'\], expected a unit"),
        (lambda f: rewrite_meta(f, num_demos=3), DemonstrationError, "num_demos = 3, but the folder holds 2"),
        (lambda f: rewrite_meta(f, objects=["door"]), DemonstrationError, "no pose of 'door'"),
        (lambda f: (f / "demo_1.npz").write_bytes(b"nonsense"), DemonstrationError, "demo_1.npz is not readable"),
        (lambda f: (f / "demo_0.npz").write_bytes(b""), DemonstrationError, "demo_0.npz is not readable"),
        (
            lambda f: (f / "demo_0.npz").write_bytes((f / "demo_0.npz").read_bytes()[:900]),
            DemonstrationError,
            "demo_0.npz is not readable",
        ),
        (lambda f: (f / "demo_1.npz").write_bytes(b""), DemonstrationError, "demo_1.npz is not readable"),
        (
            lambda f: (f / "demo_1.npz").write_bytes((f / "demo_1.npz").read_bytes()[:900]),
            DemonstrationError,
            "demo_1.npz is not readable",
        ),
        (
            lambda f: np.save(f / "a.npy", np.zeros(3)) or (f / "a.npy").rename(f / "demo_1.npz"),
            DemonstrationError,
            "demo_1.npz is not readable",
        ),
        (
            lambda f: rewrite(f / "demo_1.npz", time=np.array([{}], object)),
            DemonstrationError,
            "demo_1.npz is not readable",
        ),
        (lambda f: rewrite(f / "demo_1.npz", time=None), DemonstrationError, "has no array 'time'; it has"),
        (lambda f: rewrite(f / "demo_1.npz", joint_positions=None), DemonstrationError, "no array 'joint_positions'"),
        (lambda f: rewrite(f / "demo_1.npz", joint_positions="a"), DemonstrationError, "demo_1.npz: q is not an array"),
        (lambda f: rewrite(f / "demo_1.npz", time=np.zeros(3)), DemonstrationError, "demo_1.npz: time has shape"),
        (lambda f: rewrite(f / "demo_1.npz", pose_world_base=2 * np.eye(4)), RigidTransformError, "pose_world_base"),
        (lambda f: rewrite(f / "demo_1.npz", pose_world_base="a"), DemonstrationError, "demo_1.npz: could not convert"),
        (lambda f: (f / "demo_1.npz").unlink() or rewrite_meta(f, num_demos=1), DemonstrationError, "at least two"),
        (lambda f: (f / "demo_0.csv").write_text("time,a\n"), DemonstrationError, "both as .npz and as .csv"),
        (lambda f: (f / "demo_01.npz").write_text(""), DemonstrationError, "numbers two demonstrations 1"),
    ],
)
def test_a_folder_that_cannot_be_read_says_why(folder, spoil, error, message):
    spoil(folder)
    with pytest.raises(error, match=message):
        load_demonstrations(folder)


def test_what_meta_says_and_nobody_reads_is_told(folder):
    rewrite_meta(folder, unit="degrees", notes="by hand")
    with pytest.warns(FileWarning, match=r"\['unit'\] of meta.json are not read"):
        load_demonstrations(folder)


@pytest.mark.parametrize("stray", [b"\x89HDF\r\n\x1a\n", b"#ROSBAG V2.0\n"])
def test_numbered_files_come_before_what_lies_beside_them(tmp_path, stray):
    folder = write_tables(tmp_path / "tables")
    (folder / "stray").write_bytes(stray)
    with pytest.warns(FileWarning, match=r"\['stray'\] are not read, since there are demo_0.csv"):
        assert load_demonstrations(folder).joint_names == JOINTS
    (folder / "meta").mkdir()
    (folder / "meta" / "info.json").write_text("{}")
    with pytest.raises(DemonstrationError, match=r"holds both meta.info.json and demo_0.csv: keep one"):
        load_demonstrations(folder)


def test_files_of_two_kinds_are_not_chosen_from(tmp_path):
    (tmp_path / "a.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    (tmp_path / "b.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(DemonstrationError, match="holds both a.h5 and b.bag"):
        load_demonstrations(tmp_path)


def test_a_place_without_demonstrations_says_what_is_there(tmp_path):
    with pytest.raises(DemonstrationError, match="does not exist"):
        load_demonstrations(tmp_path / "nowhere")
    (tmp_path / "notes.txt").write_text("")
    with pytest.raises(DemonstrationError, match="is a file, and of no kind that is known"):
        load_demonstrations(tmp_path / "notes.txt")
    with pytest.raises(DemonstrationError, match=r"no demonstrations in .*which holds \['notes.txt'\]"):
        load_demonstrations(tmp_path)


def test_nothing_is_overwritten_by_accident(folder):
    with pytest.raises(DemonstrationError, match="overwrite=True"):
        save_demonstrations(demonstration_set(), folder)
    save_demonstrations(demonstration_set(), folder, overwrite=True)
    assert load_demonstrations(folder).object_names == ()
    (folder / "thesis.tex").write_text("")
    with pytest.raises(DemonstrationError, match=r"other things than demonstrations .*thesis.tex"):
        save_demonstrations(demonstration_set(), folder, overwrite=True)
    with pytest.raises(DemonstrationError, match="is a file"):
        save_demonstrations(demonstration_set(), folder / "thesis.tex")


def test_a_save_that_fails_leaves_the_old_set_and_no_debris(folder, monkeypatch):
    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save_demonstrations(demonstration_set(), folder, overwrite=True)
    monkeypatch.undo()
    assert load_demonstrations(folder).object_names == ("box", "table")
    assert [entry.name for entry in folder.parent.iterdir()] == ["demos"]


def write_tables(folder, header="time,a,b,c,box_x,box_y,box_z,box_qw,box_qx,box_qy,box_qz", row=None):
    folder.mkdir()
    half = np.sqrt(0.5)
    for k in range(2):
        rows = [[t / 30, k + t, 2 * t, 3 * t, 1, 2, 3, half, 0, 0, half][: header.count(",") + 1] for t in range(5)]
        lines = [header, *(",".join(map(str, r)) for r in rows)]
        if k == 1 and row is not None:
            lines[3] = row
        (folder / f"demo_{k}.csv").write_text("\n".join(lines) + "\n")
    return folder


def test_tables_are_read_with_poses(tmp_path):
    demonstrations = load_demonstrations(write_tables(tmp_path / "tables"))
    assert demonstrations.joint_names == JOINTS
    np.testing.assert_allclose(demonstrations[1].q[2], [3, 4, 6])
    T = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])  # a quarter turn about z
    np.testing.assert_allclose(demonstrations[0].poses["box"][4], T, atol=1e-15)


def test_tables_follow_the_joint_order_of_meta(tmp_path):
    folder = write_tables(tmp_path / "tables")
    (folder / "meta.json").write_text(json.dumps({"robot": "arm", "joint_names": ["c", "a", "b"]}))
    demonstrations = load_demonstrations(folder)
    assert (demonstrations.robot, demonstrations.joint_names) == ("arm", ("c", "a", "b"))
    np.testing.assert_allclose(demonstrations[0].q[2], [6, 2, 4])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"header": "a,time,b"}, "expected time, then the joints"),
        ({"header": "time"}, "names no joint"),
        ({"header": "time,a,a"}, "names 'a' twice"),
        ({"header": "time,a,b,c,box_x,box_qw"}, "lacks the column 'box_y'"),
        ({"row": "0.1,1,2"}, "demo_1.csv, line 4: 3 entries, but the header has 11"),
        ({"row": "0.1,one,2,3,1,2,3,1,0,0,0"}, "line 4: 'one' is not a number"),
        ({"row": "0.1,nan,2,3,1,2,3,1,0,0,0"}, "demo_1.csv: joint positions not finite at sample 2"),
        ({"row": "0.0,1,2,3,1,2,3,1,0,0,0"}, "time runs backwards at sample 2"),
    ],
)
def test_a_table_that_cannot_be_read_says_where(tmp_path, table, message):
    with pytest.raises(DemonstrationError, match=message):
        load_demonstrations(write_tables(tmp_path / "tables", **table))


def test_other_ways_in_which_tables_fail(tmp_path):
    folder = write_tables(tmp_path / "tables", row="0.1,1,2,3,1,2,3,2,0,0,0")
    with pytest.raises(RigidTransformError, match=r"'box' at sample 2 .* quaternion has length 2"):
        load_demonstrations(folder)
    (folder / "demo_1.csv").write_text("time,a,b\n0,1,2\n1,2,3\n")
    with pytest.raises(DemonstrationError, match=r"joint columns are \['a', 'b'\], expected \['a', 'b', 'c'\]"):
        load_demonstrations(folder)
    (folder / "demo_1.csv").write_bytes(b"\xff\xfe")
    with pytest.raises(DemonstrationError, match=r"demo_1.csv is not readable as a CSV file"):
        load_demonstrations(folder)
    (folder / "demo_1.csv").write_text("")
    with pytest.raises(DemonstrationError, match="the header is"):
        load_demonstrations(folder)
