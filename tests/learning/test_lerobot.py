"""LeRobot datasets, written by pyarrow in the layouts of versions 2.1 and 3.0 with what real ones have of traps."""

import json
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jaxrmp import DemonstrationError, FileWarning, MissingDependencyError, UnknownNameError
from jaxrmp.kinematics import load_robot_from_string
from jaxrmp.learning import RecordingSettings, fit_to_robot, load_demonstrations

ARM = """<robot name="arm"><link name="base"/>{}</robot>"""
JOINT = """<link name="{1}"/><joint name="{1}" type="{2}"><parent link="{0}"/><child link="{1}"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="2" effort="1"/></joint>"""
NAMES = ("pan", "lift")
DEGREES = RecordingSettings(units="degrees")
STATE = {"dtype": "float32", "shape": [3], "names": ["pan.pos", "lift.pos", "gripper.pos"]}


@pytest.fixture(scope="module")
def robot():
    return load_robot_from_string(
        ARM.format(JOINT.format("base", "pan", "revolute") + JOINT.format("pan", "lift", "prismatic"))
    )


def motion(k, samples=20):
    """Of pan in degrees, lift in m, gripper in percent."""
    s = np.linspace(0, 1, samples)[:, None]
    return np.hstack([10 * k + 60 * s, 0.5 * s, 100 - 50 * s])


def write_dataset(folder, features=None, version="v3.0", files=None, kind=np.float32, **info):
    """Episodes in the order of `files`, for each a list of episodes; columns as of `features`."""
    features = features or {"observation.state": STATE}
    (folder / "meta").mkdir(parents=True)
    files = files or ([[0, 1, 2]] if version == "v3.0" else [[0], [1], [2]])
    content = {"codebase_version": version, "fps": 10, "robot_type": "arm", "features": features} | info
    (folder / "meta" / "info.json").write_text(json.dumps(content))
    (folder / "data" / "chunk-000").mkdir(parents=True)
    for n, episodes in enumerate(files):
        rows = [(e, f, *row) for e in episodes for f, row in enumerate(motion(e))]
        table = {"episode_index": [r[0] for r in rows], "frame_index": [r[1] for r in rows]}
        table |= {"timestamp": np.array([r[1] / 10 for r in rows], np.float32), "task_index": [0] * len(rows)}
        values, used = np.array([r[2:] for r in rows]).astype(kind), 0
        for key, feature in features.items():
            size = feature["shape"][0]
            mine, used = values[:, used : used + size], used + size
            one = pa.array(mine[:, 0]) if size == 1 else pa.FixedSizeListArray.from_arrays(pa.array(mine.ravel()), size)
            table[key] = one.cast(pa.list_(one.type.value_type)) if version == "v2.1" and size > 1 else one
        name = f"file-{n:03d}" if version == "v3.0" else f"episode_{n:06d}"
        pq.write_table(pa.table(table), folder / "data" / "chunk-000" / f"{name}.parquet", row_group_size=7)
    return folder


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_episodes_are_split_and_come_in_their_units(tmp_path, robot, version):
    found = load_demonstrations(write_dataset(tmp_path / "ds", version=version), DEGREES, robot)
    assert (len(found), found.joint_names, found.units, found.robot) == (
        3,
        ("pan", "lift", "gripper"),
        "degrees",
        "arm",
    )
    np.testing.assert_allclose(found[2].q, motion(2), rtol=1e-6)
    np.testing.assert_allclose(found[2].time, np.arange(20) / 10, atol=1e-6)
    with pytest.warns(FileWarning, match=r"columns of \['gripper'\] are left out"):
        fitted = fit_to_robot(found, robot)
    np.testing.assert_allclose(fitted[1].q, motion(1)[:, :2] * [np.pi / 180, 1], rtol=1e-6)


def test_units_are_asked_for(tmp_path):
    with pytest.raises(
        DemonstrationError, match=r"nothing says the units .*from 0 to 100\)\. Say --units .*rad or deg"
    ):
        load_demonstrations(write_dataset(tmp_path / "ds"))


def test_shares_of_the_range_are_spread_over_the_limits_and_said(tmp_path, robot):
    found = load_demonstrations(write_dataset(tmp_path / "ds"), RecordingSettings(units="normalised"), robot)
    with pytest.warns(FileWarning, match="range between the limits of the robot's file"):
        fitted = fit_to_robot(found, robot)
    np.testing.assert_allclose(fitted[0].q[-1], [2 * 0.60, 2 * 0.005], rtol=1e-5)


def test_a_gripper_of_shares_from_zero_is_refused(tmp_path):
    joints = JOINT.format("base", "pan", "revolute") + JOINT.format("pan", "lift", "prismatic")
    with_gripper = load_robot_from_string(ARM.format(joints + JOINT.format("lift", "gripper", "revolute")))
    found = load_demonstrations(write_dataset(tmp_path / "ds"), RecordingSettings(units="normalised"), with_gripper)
    with pytest.raises(DemonstrationError, match=r"joints \['gripper'\] are never below 0.* lock them"):
        fit_to_robot(found, with_gripper)


@pytest.mark.parametrize("spoiled", [-1.0, np.nan])
def test_time_stamps_that_cannot_be_are_told(tmp_path, spoiled):
    folder = write_dataset(tmp_path / "ds")
    file = folder / "data" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(file)
    stamps = table["timestamp"].to_numpy().copy()
    stamps[27] = spoiled  # of episode 1
    pq.write_table(table.set_column(table.schema.get_field_index("timestamp"), "timestamp", pa.array(stamps)), file)
    with pytest.warns(FileWarning, match=r"time stamps of episodes 1 run backwards.*: 10 samples a second are taken"):
        found = load_demonstrations(folder, DEGREES)
    np.testing.assert_allclose(found[1].time, np.arange(20) / 10)


def test_episodes_lie_in_any_order_and_across_files(tmp_path):
    """Neither the order of files nor that of rows says which episode a row is of."""
    folder = write_dataset(tmp_path / "ds", files=[[2, 0], [1]])
    file = folder / "data" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(file)
    pq.write_table(table.slice(5).take(pa.array(range(34, -1, -1))), file)
    pq.write_table(table.slice(0, 5), folder / "data" / "chunk-000" / "file-002.parquet")
    found = load_demonstrations(folder, DEGREES)
    np.testing.assert_allclose(found[2].q, motion(2), rtol=1e-6)
    np.testing.assert_allclose(found[0].q, motion(0), rtol=1e-6)


@pytest.mark.parametrize(
    "names",
    [
        {"motors": ["pan", "lift", "gripper"]},
        {"arm": {"axes": ["pan", "lift"]}, "hand": ["gripper"]},
        {"lift": 1, "pan": 0, "gripper": 2},
    ],
)
def test_names_are_found_where_they_are_nested(tmp_path, names):
    folder = write_dataset(tmp_path / "ds", {"observation.state": STATE | {"names": names}})
    assert load_demonstrations(folder, DEGREES).joint_names == ("pan", "lift", "gripper")


def test_columns_without_names_are_the_robots_if_as_many_and_said(tmp_path, robot):
    unnamed = {"dtype": "float32", "shape": [2], "names": None}
    folder = write_dataset(tmp_path / "ds", {"observation.state": unnamed})
    with pytest.warns(
        FileWarning, match=r"names no joints: its 2 columns are taken for \['pan', 'lift'\], in this order"
    ):
        assert load_demonstrations(folder, DEGREES, robot).joint_names == NAMES
    named = RecordingSettings(units="degrees", columns=("lift", "pan"))
    assert load_demonstrations(folder, named, robot).joint_names == ("lift", "pan")
    folder = write_dataset(tmp_path / "more", {"observation.state": unnamed | {"shape": [3], "names": ["state"]}})
    found = load_demonstrations(folder, DEGREES, robot)
    with pytest.raises(DemonstrationError, match=r"'observation.state\[0\]'.*recording.columns"):
        fit_to_robot(found, robot)
    with pytest.raises(DemonstrationError, match="recording.columns names 1 columns, but observation.state .* has 3"):
        load_demonstrations(folder, RecordingSettings(columns=("pan",)))


def test_groups_are_told_apart_by_the_robots_joints_or_asked_for(tmp_path, robot):
    groups = {
        "observation.arm": STATE | {"shape": [2], "names": ["pan", "lift"]},
        "observation.hand": STATE | {"shape": [1], "names": None},
        "action": STATE,
    }
    folder = write_dataset(tmp_path / "ds", {k: groups[k] for k in ("observation.arm", "observation.hand")})
    assert load_demonstrations(folder, DEGREES, robot).joint_names == NAMES
    with pytest.raises(DemonstrationError, match=r"several groups of joints: .*arm \['pan', 'lift'\]; .*hand \(1 col"):
        load_demonstrations(folder, DEGREES)
    both = RecordingSettings(units="degrees", group="observation.hand, observation.arm")
    found = load_demonstrations(folder, both, robot)
    assert found.joint_names == ("observation.hand[0]", *NAMES) and "left out: nothing" in found.layout
    np.testing.assert_allclose(found[1].q, motion(1)[:, [2, 0, 1]], rtol=1e-6)
    with pytest.raises(UnknownNameError, match=r"group of joints in .*Did you mean 'observation.arm'"):
        load_demonstrations(folder, RecordingSettings(group="observation.arms"))


def test_half_precision_and_chosen_episodes(tmp_path):
    folder = write_dataset(tmp_path / "ds", {"observation.state": STATE | {"dtype": "float16"}}, kind=np.float16)
    found = load_demonstrations(folder, RecordingSettings(units="degrees", episodes=(0, 2), rate=20))
    np.testing.assert_allclose(found[1].q, motion(2), rtol=1e-3)
    assert len(found) == 2 and found[0].time[-1] == 19 / 20
    with pytest.raises(DemonstrationError, match=r"no episode 7 \(recording.episodes\); it has 0 to 2"):
        load_demonstrations(folder, RecordingSettings(episodes=(7,)))


def test_other_tasks_and_episodes_that_are_not_there_are_told(tmp_path):
    folder = write_dataset(tmp_path / "ds", total_episodes=5)
    file = folder / "data" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(file)
    tasks = pa.array(np.minimum(table["episode_index"].to_numpy(), 1))
    pq.write_table(table.set_column(table.schema.get_field_index("task_index"), "task_index", tasks), file)
    with pytest.warns(
        FileWarning, match=r"says 5 episodes, the data hold 3.* 2 tasks .*0: episodes 0; 1: episodes 1, 2\)"
    ):
        load_demonstrations(folder, DEGREES)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: (f / "meta" / "info.json").write_text("{"), "info.json is not readable as JSON"),
        (lambda f: (f / "meta" / "info.json").write_text("{}"), "info.json has no 'features'"),
        (lambda f: next((f / "data").rglob("*.parquet")).write_bytes(b"PAR1"), r"file-000.parquet is not readable"),
        (lambda f: next((f / "data").rglob("*.parquet")).unlink(), "holds no .parquet files: download"),
    ],
)
def test_a_dataset_that_cannot_be_read_says_why(tmp_path, spoil, message):
    folder = write_dataset(tmp_path / "ds")
    spoil(folder)
    with pytest.raises(DemonstrationError, match=message):
        load_demonstrations(folder, DEGREES)


def test_versions_rows_and_columns_that_do_not_fit(tmp_path):
    with pytest.raises(DemonstrationError, match="of LeRobotDataset v1.6; versions 2 and 3 are read"):
        load_demonstrations(write_dataset(tmp_path / "old", codebase_version="v1.6"))
    folder = write_dataset(tmp_path / "wide")
    info = json.loads((folder / "meta" / "info.json").read_text())
    info["features"]["observation.state"]["shape"] = [4]
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    with pytest.raises(
        DemonstrationError, match="'observation.state' holds 180 numbers in 60 rows, expected 4 in each"
    ):
        load_demonstrations(folder)
    info["features"] = {"observation.other": STATE}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    with pytest.raises(DemonstrationError, match="has no column 'observation.other'"):
        load_demonstrations(folder)


@pytest.mark.parametrize(
    ("package", "magic"), [("pyarrow", b""), ("rosbags", b"#ROSBAG V2.0\n"), ("h5py", b"\x89HDF\r\n\x1a\n")]
)
def test_a_package_that_is_not_there_is_named_with_its_extra(tmp_path, monkeypatch, package, magic):
    file = tmp_path / "file"
    file.write_bytes(magic)
    for module in [m for m in sys.modules if m.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingDependencyError, match=rf"{package} is needed .*pip install 'jaxrmp\[formats\]'"):
        load_demonstrations(file if magic else write_dataset(tmp_path / "ds"))
