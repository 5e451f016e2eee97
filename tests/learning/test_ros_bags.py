"""ROS bags, written by rosbags: joint states as drivers leave them, and transforms of a tracked object."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from jaxrmp import DemonstrationError, FileWarning, UnknownNameError
from jaxrmp.kinematics import load_robot_from_string
from jaxrmp.learning import RecordingSettings, fit_to_robot, load_demonstrations

ARM = """<robot name="arm"><link name="base_link"/><link name="a"/><link name="b"/>
<joint name="pan" type="revolute"><parent link="base_link"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="2" effort="1"/></joint>
<joint name="lift" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="2" effort="1"/></joint></robot>"""
NAMES = ("pan", "lift")
START = 1_700_000_000  # s
KINDS = [".bag", StoragePlugin.SQLITE3, StoragePlugin.MCAP]
HALF = np.sqrt(0.5)


@pytest.fixture(scope="module")
def robot():
    return load_robot_from_string(ARM)


def at(t):
    return [0.4 * t, -0.2 * t]


def states(k=0, names=NAMES, count=40, values=at, stamp=lambda t: t, topic="/joint_states"):
    """Messages of a motion of two seconds, as (topic, logged, what)."""
    times = np.linspace(0, 2, count) + 0.01 * k
    return [(topic, t, (stamp(t), list(names), values(t))) for t in times]


def transform(parent, child, t, p, q, topic="/tf"):
    return topic, t, (t, parent, child, p, q)


def write_bag(path, messages, kind=StoragePlugin.MCAP):
    first = kind == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    make = store.types
    path.parent.mkdir(parents=True, exist_ok=True)

    def header(t, frame=""):
        seconds, rest = divmod(START * 10**9 + round(t * 1e9) if t is not None else 0, 10**9)
        stamp = make["builtin_interfaces/msg/Time"](sec=int(seconds), nanosec=int(rest))
        return make["std_msgs/msg/Header"](**({"seq": 0} if first else {}), stamp=stamp, frame_id=frame)

    def state(t, names, position):
        none = np.zeros(0)
        kind = make["sensor_msgs/msg/JointState"]
        return kind(header=header(t), name=names, position=np.array(position, float), velocity=none, effort=none)

    def tf(t, parent, child, p, q):
        moved = make["geometry_msgs/msg/Transform"](
            translation=make["geometry_msgs/msg/Vector3"](*map(float, p)),
            rotation=make["geometry_msgs/msg/Quaternion"](*map(float, q)),
        )
        one = make["geometry_msgs/msg/TransformStamped"](header(t, parent), child_frame_id=child, transform=moved)
        return make["tf2_msgs/msg/TFMessage"](transforms=[one])

    with Writer1(path) if first else Writer2(path, version=9, storage_plugin=kind) as writer:
        connections = {}
        for topic, logged, what in sorted(messages, key=lambda m: m[1]):
            name = "tf2_msgs/msg/TFMessage" if topic.startswith("/tf") else "sensor_msgs/msg/JointState"
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            message = (tf if topic.startswith("/tf") else state)(*what)
            serialize = store.serialize_ros1 if first else store.serialize_cdr
            writer.write(connections[topic], START * 10**9 + round(logged * 1e9), serialize(message, name))
    return path


def write_bags(folder, *each, kind=StoragePlugin.MCAP):
    for k, messages in enumerate(each):
        write_bag(folder / f"take_{k}{kind if kind == '.bag' else ''}", messages, kind)
    return folder


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_positions_go_by_name_whatever_their_order_and_the_other_robots_joints_are_left_out(tmp_path, robot, kind):
    other = ("gripper", "other_pan", "lift", "pan")
    folder = write_bags(
        tmp_path / "bags",
        [*states(), *states(5, ("lift", "pan"), values=lambda t: at(t)[::-1])],
        states(0, other, values=lambda t: [0.04, 9.0, *at(t)[::-1]]),
        kind=kind,
    )
    with pytest.warns(FileWarning, match=r"\['gripper', 'other_pan'\] are no moving joints of the robot and left out"):
        found = load_demonstrations(folder, robot=robot)
    assert len(found) == 2 and set(found.joint_names) == set(NAMES) and found.units == "rad"
    for demonstration in fit_to_robot(found, robot):
        np.testing.assert_allclose(demonstration.q, np.transpose(at(demonstration.time)), atol=1e-8)
        assert demonstration.time[0] == 0.0 and 1.99 < demonstration.time[-1] < 2.06


def test_settings_that_say_nothing_of_a_bag_are_told(tmp_path):
    folder = write_bags(tmp_path, states(), states())
    with pytest.warns(FileWarning, match=r"\(--rate\) is not used: the stamps.*\(--quaternion\) is of poses"):
        found = load_demonstrations(folder, RecordingSettings(rate=50, quaternion="wxyz"))
    assert found[0].time[-1] == pytest.approx(2.0)


def test_another_devices_messages_on_the_topic_do_not_cut_the_recording(tmp_path, robot):
    gripper = states(names=("gripper",), values=lambda t: [0.04], count=3, stamp=lambda t: 0.8 + t / 8)
    folder = write_bags(tmp_path, [*states(), *gripper], [*states(), *gripper])
    with pytest.warns(FileWarning, match=r"\['gripper'\] are no moving joints of the robot and left out"):
        found = load_demonstrations(folder, robot=robot)
    assert found.joint_names == NAMES and found[0].time[-1] == pytest.approx(2.0)


def test_storage_files_without_their_metadata_and_in_the_order_of_their_numbers(tmp_path):
    for k, bag in enumerate(write_bag(tmp_path / f"b{k}", states(values=lambda t, k=k: [k, t])) for k in range(11)):
        next(bag.glob("*.mcap")).rename(tmp_path / f"take_{k}.mcap")
        (bag / "metadata.yaml").unlink()
    found = load_demonstrations(tmp_path)
    assert [d.q[0, 0] for d in found] == list(range(11))
    assert [d.q[0, 0] for d in load_demonstrations(tmp_path, RecordingSettings(episodes=(2, 10)))] == [2, 10]


def test_joints_in_messages_of_their_own_are_interpolated_and_said(tmp_path, robot):
    apart = [
        *states(names=("pan",), values=lambda t: at(t)[:1]),
        *states(names=("lift",), values=lambda t: at(t)[1:], count=9, stamp=lambda t: t + 0.7),
    ]
    with pytest.warns(FileWarning, match=r"\['lift'\] come in messages of their own .*interpolated; 0.7\d* s in which"):
        found = load_demonstrations(write_bags(tmp_path, apart, apart), robot=robot)
    q, time = found[0].q, found[0].time
    np.testing.assert_allclose(q[:, 0], q[0, 0] + 0.4 * time, atol=1e-8)
    np.testing.assert_allclose(q[:, 1], q[0, 1] - 0.2 * time, atol=1e-8)
    assert -0.01 < q[0, 1] <= 0.0  # lift has just begun


def test_stamps_that_go_back_a_little_are_put_in_order_and_a_reset_clock_is_refused(tmp_path):
    late = states(
        stamp=lambda t: t - (0.12 if 1.0 < t < 1.03 else 0), values=lambda t: [t - (0.12 if 1.0 < t < 1.03 else 0), 0]
    )
    with pytest.warns(
        FileWarning, match=r"take_0: 1 messages of /joint_states come late, by up to 0.\d+ s: put in order"
    ):
        found = load_demonstrations(write_bags(tmp_path / "late", late, states()))
    assert (np.diff(found[0].time) > 0).all() and (np.diff(found[0].q[:, 0]) > 0).all()
    again = states(stamp=lambda t: t - (5 if t > 1 else 0))
    with pytest.raises(DemonstrationError, match=r"take_1.* go back by 4.95 s at message 20.*clock .* Cut"):
        load_demonstrations(write_bags(tmp_path / "reset", states(), again))


def test_messages_without_stamps_or_positions(tmp_path):
    empty = [*states(stamp=lambda t: None), *states(5, values=lambda t: [])]
    with pytest.warns(FileWarning, match=r"40 messages of /joint_states without a position.*no stamps of their own"):
        found = load_demonstrations(write_bags(tmp_path, empty, states()))
    np.testing.assert_allclose(found[0].time, np.linspace(0, 2, 40), atol=1e-6)


def test_topics_are_told_apart_by_the_robots_joints_or_asked_for(tmp_path, robot):
    left = ("left_pan", "left_lift")
    two = [*states(topic="/right"), *states(names=left, topic="/left")]
    folder = write_bags(tmp_path / "two", two, two)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load_demonstrations(folder, robot=robot).joint_names == NAMES
    with pytest.raises(DemonstrationError, match=r"groups of joints: /left \['left_pan', 'left_lift'\]; /right"):
        load_demonstrations(folder)
    assert load_demonstrations(folder, RecordingSettings(group="/left")).joint_names == left
    wished = [*states(), *states(values=lambda t: [0, 0], topic="/wanted_states")]
    found = load_demonstrations(write_bags(tmp_path / "wished", wished, wished), robot=robot)
    assert found.layout.startswith("2 bags: /joint_states; of topics /joint_states, /wanted") and found[0].q[
        -1, 0
    ] == pytest.approx(0.8)


def test_a_tracked_object_is_found_through_the_transforms(tmp_path, robot):
    """World to the camera, which stands still; camera to the cup, which turns; the robot's root hangs on the world."""
    turn = [
        transform("camera", "cup", t, [t, 0, 1], [0, 0, np.sin(t / 2), np.cos(t / 2)])
        for t in np.linspace(-0.1, 2.2, 8)
    ]
    still = [
        transform("/world", "camera", 0, [1, 0, 0], [0, 0, HALF, HALF], "/tf_static"),
        transform("world", "base_link", 0, [0, 2, 0], [0, 0, 0, 1], "/tf_static"),
    ]
    bag = [*states(), *turn, *still, transform("base_link", "a", 1, [0, 0, 0], [0, 0, 0, 1])]
    folder = write_bags(tmp_path / "bags", bag, bag)
    found = load_demonstrations(folder, robot=robot, base="base_link", tracked="cup")
    t = found[1].time[13]
    a = np.pi / 2 + t
    T = [[np.cos(a), -np.sin(a), 0, 1], [np.sin(a), np.cos(a), 0, t - 2], [0, 0, 1, 1], [0, 0, 0, 1]]
    np.testing.assert_allclose(found[1].poses["cup"][13], T, atol=1e-8)
    assert found.layout.endswith("frames camera, cup, world, base_link, a")
    same = load_demonstrations(folder, robot=robot, base="world", tracked="cup")  # the model's root, not the bag's
    np.testing.assert_allclose(same[1].poses["cup"], found[1].poses["cup"], atol=1e-12)
    assert load_demonstrations(folder, base="world", tracked="camera")[0].poses["camera"][1, 3] == 0.0
    with pytest.raises(UnknownNameError, match=r"frame of the transforms .*'cop'. Did you mean 'cup'"):
        load_demonstrations(folder, robot=robot, tracked="cop")
    alone = [*states(), transform("base_link", "cup", 1.0, [1, 0, 0], [0, 0, 0, 1])]
    with pytest.warns(FileWarning, match="the pose of 'cup' is up to 1 s away from the nearest that was recorded"):
        found = load_demonstrations(write_bags(tmp_path / "alone", alone, alone), robot=robot, tracked="cup")
    np.testing.assert_allclose(found[0].poses["cup"][:, 0, 3], 1.0)  # the root link stands for the robot's world
    both = [*alone, transform("a", "cup", 1.5, [1, 0, 0], [0, 0, 0, 1])]
    with pytest.raises(DemonstrationError, match="frame 'cup' has two parents, 'base_link' and 'a'"):
        load_demonstrations(write_bags(tmp_path / "both", both, both), robot=robot, tracked="cup")


def test_bags_that_cannot_be_read_say_why(tmp_path):
    only_tf = [transform("a", "b", t, [0, 0, 0], [0, 0, 0, 1]) for t in (0, 1)]
    with pytest.raises(DemonstrationError, match=r"no messages of sensor_msgs/msg/JointState; it has /tf \(tf2_msgs"):
        load_demonstrations(write_bags(tmp_path / "tf", only_tf, only_tf))
    folder = write_bags(tmp_path / "cut", states(), states(), kind=".bag")
    (folder / "take_1.bag").write_bytes((folder / "take_1.bag").read_bytes()[:3000])
    with pytest.raises(DemonstrationError, match=r"take_1.bag is not readable as a bag"):
        load_demonstrations(folder)
    with pytest.raises(DemonstrationError, match="received 1 demonstration"):
        load_demonstrations(write_bag(tmp_path / "alone", states()))
    with pytest.raises(DemonstrationError, match=re.escape("has the joints ['pan'], ") + ".*'lift', 'pan'"):
        load_demonstrations(write_bags(tmp_path / "less", states(), states(names=("pan",), values=lambda t: [t])))
    assert not list(Path(tmp_path).rglob("*-wal"))
