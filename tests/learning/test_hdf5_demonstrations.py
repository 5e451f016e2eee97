"""HDF5 files as robomimic and robosuite write them, by h5py; states by MuJoCo itself."""

import json

import h5py
import mujoco
import numpy as np
import pytest

from jaxrmp import DemonstrationError, FileWarning, UnknownNameError
from jaxrmp.kinematics import load_robot_from_string
from jaxrmp.learning import RecordingSettings, fit_to_robot, load_demonstrations
from jaxrmp.learning._mujoco_states import MujocoStates

ARM = """<robot name="arm"><link name="base"/><link name="a"/><link name="b"/>
<joint name="robot0_joint1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="2" effort="1"/></joint>
<joint name="robot0_joint2" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="2" effort="1"/></joint></robot>"""
NAMES = ("robot0_joint1", "robot0_joint2")
SIZE = 'size="0.1" mass="1"'
MODEL = f"""<mujoco><worldbody><body name="cup_main" pos="1 2 3"><freejoint name="cup_joint0"/><geom {SIZE}/></body>
<body name="robot0_base" pos="0.5 0 1" quat="1 0 0 1"><geom {SIZE}/><body name="robot0_link1" pos="0 0 0.3">
<joint name="robot0_joint1" axis="0 0 1"/><geom {SIZE}/><body name="robot0_link2"><joint name="robot0_joint2"/>
<geom {SIZE}/></body></body></body>
<body name="door"><joint name="door_hinge"/><geom {SIZE}/></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def robot():
    return load_robot_from_string(ARM)


def motion(k, count=20):
    return np.linspace([0, -0.1 * k], [0.5, 0.3], count)


def states(k, count=20):
    """MuJoCo's own, of the arm's motion while the cup turns, and the cup's poses in the frame of the arm's base."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    rows, poses = [], []
    for t, q in enumerate(motion(k, count)):
        data.time = 0.05 * t
        data.qpos = [0.1 * t, 0.2, 1.3, np.cos(0.02 * t), 0, np.sin(0.02 * t), 0, *q, 0.7]
        mujoco.mj_forward(model, data)
        rows.append([data.time, *data.qpos, *data.qvel])
        base, cup = (data.body(name) for name in ("robot0_base", "cup_main"))
        R = base.xmat.reshape(3, 3).T
        poses.append(np.vstack([np.c_[R @ cup.xmat.reshape(3, 3), R @ (cup.xpos - base.xpos)], [0, 0, 0, 1]]))
    return np.array(rows), np.array(poses)


def write_file(file, numbers=(1, 2, 10), obs=("robot0_joint_pos",), with_states=False, **attributes):
    with h5py.File(file, "w") as content:
        data = content.create_group("data")
        data.attrs.update(attributes)
        for k in numbers:
            demo = data.create_group(f"demo_{k}")
            demo["actions"] = np.zeros((20, 7))
            for name in obs:
                demo[f"obs/{name}"] = motion(k).astype(np.float32)
            if obs:
                demo["obs/agentview_image"] = np.zeros((20, 2, 2, 3), np.uint8)
            if with_states:
                demo.attrs["model_file"] = MODEL
                demo["states"] = states(k)[0]
    return file


RATE = {"env_args": json.dumps({"env_name": "Lift", "type": 1, "env_kwargs": {"control_freq": 20}})}


def test_observations_come_in_the_order_of_numbers_at_the_rate_of_the_environment(tmp_path, robot):
    file = write_file(tmp_path / "low_dim.hdf5", **RATE)
    with pytest.warns(
        FileWarning, match=r"obs/robot0_joint_pos names no joints: its 2 columns are taken for \['robot0"
    ):
        found = load_demonstrations(file, robot=robot)
    assert found.joint_names == NAMES and found.units == "rad"
    assert "20 samples a second: obs/robot0_joint_pos; left out: agentview_image" in found.layout
    for k, demonstration in zip((1, 2, 10), found, strict=True):
        np.testing.assert_allclose(demonstration.q, motion(k), atol=1e-7)
        np.testing.assert_allclose(demonstration.time, np.arange(20) / 20)
    with pytest.warns(FileWarning):  # a folder with nothing else of the kind
        chosen = load_demonstrations(tmp_path, RecordingSettings(episodes=(2, 10), rate=40), robot)
    assert len(chosen) == 2 and chosen[0].time[-1] == 19 / 40


def test_states_have_names_and_time_and_the_object(tmp_path, robot):
    """Of robosuite's own files, which hold no observations and no rate."""
    file = write_file(tmp_path / "demo.hdf5", (1, 2), (), True, env_info=json.dumps({"robots": "Panda"}))
    found = load_demonstrations(file, robot=robot, tracked="cup_main")
    fit_to_robot(found, robot)
    assert found.joint_names == NAMES and "states/robot0" in found.layout
    for k, demonstration in zip((1, 2), found, strict=True):
        np.testing.assert_allclose(demonstration.q, motion(k), atol=1e-12)
        np.testing.assert_allclose(demonstration.time, 0.05 * np.arange(20), atol=1e-12)
        np.testing.assert_allclose(demonstration.poses["cup_main"], states(k)[1], atol=1e-12)
    with pytest.raises(UnknownNameError, match=r"free body in .*demo_1 'door'.* Valid: cup_main, cup_joint0"):
        load_demonstrations(file, robot=robot, tracked="door")


def test_two_robots_are_asked_for(tmp_path):
    file = write_file(tmp_path / "two.hdf5", obs=("robot0_joint_pos", "robot1_joint_pos"), **RATE)
    with pytest.raises(
        DemonstrationError, match=r"several groups of joints: obs/robot0_joint_pos \(2 columns\); obs/rob"
    ):
        load_demonstrations(file)
    named = RecordingSettings(group="obs/robot1_joint_pos", columns=("left", "right"))
    assert load_demonstrations(file, named).joint_names == ("left", "right")


def test_absolute_positions_of_isaac_lab_are_taken_not_its_offsets(tmp_path):
    file = write_file(tmp_path / "isaac.hdf5", obs=("joint_pos",), env_args=json.dumps({"type": 2}))
    with h5py.File(file, "a") as content:
        for k in (1, 2, 10):
            content[f"data/demo_{k}/states/articulation/robot/joint_position"] = motion(k) + 1
    found = load_demonstrations(file, RecordingSettings(rate=50))
    np.testing.assert_allclose(found[0].q, motion(1) + 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"numbers": ()}, r"no groups data/demo_0.*it has \['data'\]"),
        ({"env_args": "{"}, "demo_1: nothing says the time: no control_freq in env_args. Say recording.rate"),
        ({"obs": ()}, "holds no joint positions that are known as such"),
    ],
)
def test_a_file_that_cannot_be_read_says_why(tmp_path, change, message):
    with pytest.raises(DemonstrationError, match=message):
        load_demonstrations(write_file(tmp_path / "demo.hdf5", **change))


def test_a_damaged_file_and_demonstrations_that_lack_something(tmp_path, robot):
    file = write_file(tmp_path / "demo.hdf5", with_states=True, **RATE)
    with h5py.File(file, "a") as content:
        del content["data/demo_2/obs/robot0_joint_pos"]
    with pytest.raises(DemonstrationError, match="demo_2 has no table 'obs/robot0_joint_pos'"):
        load_demonstrations(file, robot=robot)
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(DemonstrationError, match="demo.hdf5 is not readable as HDF5"):
        load_demonstrations(file)


def test_joints_in_frames_are_counted_and_bases_placed_by_them():
    inner = '<joint name="robot0_joint1" axis="0 0 1"/>'
    framed = MODEL.replace(inner, f'<frame pos="0 0 1">{inner}</frame>').replace(
        '<body name="robot0_base" pos="0.5 0 1" quat="1 0 0 1">',
        '<frame pos="0.5 0 1" quat="1 0 0 1"><body name="robot0_base">',
    )
    framed = framed.replace('<body name="door">', '</frame><body name="door">')
    model = mujoco.MjModel.from_xml_string(framed)
    table, poses = states(1)
    assert model.nq + model.nv + 1 == table.shape[1]
    found = MujocoStates.read(framed, table, "here")
    assert {name: first for name, (_, first, _) in found.joints.items()} == {
        model.joint(j).name: model.jnt_qposadr[j] for j in range(model.njnt)
    }
    np.testing.assert_allclose(found.object_pose("cup_main", "states/robot0"), poses, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<body name="door">', '<replicate count="2"/><body name="door">', "model has a <replicate>"),
        ('<joint name="door_hinge"/>', "", r"shape \(20, 20\) are not of the model, whose 9 positions and 8 vel"),
        ('quat="1 0 0 1"', 'euler="0 0 90"', "robot0_base: that body moves, or is turned by euler"),
        ('quat="1 0 0 1">', '><joint name="rail" type="hinge"/>', None),
    ],
)
def test_models_whose_states_or_bases_are_not_known_are_refused(old, new, message):
    table = states(1)[0]
    if message is None:
        table, message = np.hstack([table, np.zeros((20, 2))]), "robot0_base: that body moves"
    with pytest.raises(DemonstrationError, match=message):
        MujocoStates.read(MODEL.replace(old, new), table, "here").object_pose("cup_main", "states/robot0")


def test_states_of_actuators_explain_more_columns():
    table = np.hstack([states(1)[0], np.zeros((20, 1))])
    acts = '</worldbody><actuator><intvelocity joint="door_hinge"/><motor joint="door_hinge"/></actuator>'
    model = MODEL.replace("</worldbody>", acts)
    assert MujocoStates.read(model, table, "here").qpos.shape == (20, 10)
    with pytest.raises(DemonstrationError, match="are not of the model"):
        MujocoStates.read(MODEL, table, "here")
