"""Robots as they were loaded, in physics: one arm of a file, on a wall, with joints locked, driven as the file says."""

import jax
import mujoco
import numpy as np
import pytest

from jaxrmp import FileWarning, RobotError, UnsafeFileWarning
from jaxrmp.kinematics import frame_poses, load_robot, load_robot_from_string
from jaxrmp.scenes import Scene, arm_alone, robot_spec

ARM = """<frame pos="{1} 0 .2" euler="0 0 .4"><body name="{0}_base" euler="0 .3 0"><geom size=".05"/>
<body name="{0}_upper" pos="0 0 .1"><joint name="{0}_lift" type="slide" axis="0 .1 1" range="-.1 .3" ref=".1"/>
<joint name="{0}_pan" axis="0 0 1" pos=".02 0 0" range="-2 2"/><joint name="{0}_tilt" axis="0 1 0" pos="0 0 .05"
range="-2 2" ref=".2"/><geom size=".05"/><body name="{0}_fore" pos=".3 0 0" euler=".1 .2 .3"><joint axis="1 0 .2"
range="-2 2"/><geom size=".04"/><site name="{0}_tip" pos=".2 0 .1" euler="0 .5 0"/></body></body></body></frame>"""
BOTH = f"""<mujoco model="both"><compiler angle="radian" autolimits="true"/><worldbody>
<geom name="floor" type="plane" size="2 2 .1"/><site name="mark" pos="0 1 0"/>
<body name="turn" pos="0 0 .5"><joint name="turn" axis="0 0 1" range="-1 1"/><geom size=".1"/>
{ARM.format("a", 0.2)}{ARM.format("b", -0.2)}</body>
<body name="cup" pos="1 0 0"><freejoint/><geom size=".03"/></body></worldbody>
<contact><exclude body1="a_fore" body2="b_fore"/></contact>
<tendon><fixed name="span"><joint joint="a_pan" coef="1"/><joint joint="b_pan" coef="1"/></fixed></tendon>
<sensor><jointpos joint="a_pan"/></sensor>
<actuator><motor joint="a_pan" ctrlrange="-3 3"/><motor joint="b_pan" ctrlrange="-4 4"/>
<position joint="b_tilt" kp="9" forcerange="-5 5" gear="2"/><motor joint="turn"/></actuator>
<keyframe><key name="home" qpos="{"0 " * 9} 1 0 0 .1 1 0 0 0"/></keyframe></mujoco>"""
WALL = np.array([[0.0, 0, 1, 0.2], [1, 0, 0, 0.3], [0, 1, 0, 0.8], [0, 0, 0, 1]])
LINK = """<link name="{0}"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><sphere radius=".2"/></geometry></collision></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>
<origin xyz="0 .1 .3" rpy=".1 .2 .3"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="{3}"/></joint>"""
URDF = f"""<robot name="u">{"".join(map(LINK.format, ("base", "one", "two", "three")))}
{JOINT.format("j1", "base", "one", 30)}{JOINT.format("j2", "one", "two", 20)}
{JOINT.format("j3", "two", "three", 0)}</robot>"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "both.xml").write_text(BOTH)
    (tmp_path / "wall.urdf").write_text(URDF)
    return tmp_path / "both.xml"


def assert_same_poses(robot, scene):
    """MuJoCo has the frames of the scene's model where our own kinematics has them."""
    m, data = scene.model, scene.fresh()
    bodies = {m.body(i).name for i in range(m.nbody)}
    names = [name for name in robot.frame_names if name != "world"]
    for q in np.random.default_rng(0).uniform(robot.lower, robot.upper, (3, robot.num_joints)):
        data.qpos[scene.arm_qpos] = q
        mujoco.mj_kinematics(m, data)
        found = [data.body(name) if name in bodies else data.site(name) for name in names]
        with jax.enable_x64(True):
            expected = np.asarray(frame_poses(robot, q, names))
        np.testing.assert_allclose([f.xpos for f in found], expected[:, :3, 3], atol=1e-9)
        np.testing.assert_allclose([f.xmat.reshape(3, 3) for f in found], expected[:, :3, :3], atol=1e-9)


@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
@pytest.mark.parametrize(
    "arguments",
    [
        {"fixed": {"*_lift": 0.2, "a_pan": 0.4, "b_tilt": -0.5, "turn": 0.3}},  # before and after joints that move
        {"root": "a_base", "mount": WALL, "fixed": {"a_lift": 0.0, "turn": 0.5}},
        {"root": "b_base", "mount": WALL, "tools": {"tcp": ("b_tip", WALL)}},
        {"mount": WALL},
    ],
)
def test_what_stands_where_is_as_the_robot_was_loaded(arguments, file):
    robot = load_robot(file, **arguments)
    spec = robot_spec(robot)
    for name in robot.joint_names:  # such as have no motor in this file
        if not any(a.target == name for a in spec.actuators):
            spec.add_actuator(target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    scene = Scene("both", spec, robot, object="")
    assert_same_poses(robot, scene)
    assert scene.model.njnt == robot.num_joints and "cup" not in {b.name for b in spec.bodies}
    data, T = scene.fresh(), arguments.get("mount", np.eye(4))
    mujoco.mj_kinematics(scene.model, data)
    np.testing.assert_allclose(data.geom("floor").xmat.reshape(3, 3), T[:3, :3], atol=1e-9)
    np.testing.assert_allclose(data.geom("floor").xpos, T[:3, 3], atol=1e-9)


def test_a_urdf_on_a_wall_is_driven_within_its_efforts(file):
    wall = load_robot(file.with_name("wall.urdf"), mount=WALL, tools={"tcp": ("three", WALL)})
    with pytest.warns(UnsafeFileWarning, match=r"no torque limit of \['j3'\].*effort"):
        scene = arm_alone(wall.source, wall)
    assert_same_poses(wall, scene)
    np.testing.assert_array_equal(scene.torque_limit, [30, 20, np.inf])


@pytest.mark.filterwarnings("ignore::jaxrmp.UnsafeFileWarning")
def test_links_of_a_urdf_that_are_neighbours_do_not_touch_and_others_do(file):
    """The base is one: MuJoCo would have a link touch a neighbour that stands still."""
    scene = arm_alone(file.with_name("wall.urdf"))
    for q, touching in (([0.0, 0, 0], []), ([1.95, 0, 0], ["base - two"])):
        data = scene.fresh()
        data.qpos[scene.arm_qpos] = q
        mujoco.mj_forward(scene.model, data)
        assert [" - ".join(sorted(pair.split(" - "))) for pair in scene.contacts(data)] == touching
    always = URDF.replace('radius=".2"', 'radius=".35"')
    file.with_name("always.urdf").write_text(always)
    with pytest.warns(FileWarning, match="geometry of base - three, base - two, one - three meets"):
        arm_alone(file.with_name("always.urdf"))


def test_a_robot_file_in_toml_is_an_arm_alone(file):
    described = file.with_name("b.toml")
    described.write_text('file = "both.xml"\nroot = "b_base"\n[fixed]\nb_lift = 0.1\njoint_8 = 0.2\n')
    with pytest.warns(FileWarning, match=r"\['b_tilt'\] are no plain motors"):
        scene = arm_alone(described)
    assert_same_poses(scene.robot, scene)
    np.testing.assert_array_equal(scene.torque_limit, [4, 10])


def test_an_arm_that_nothing_can_drive_is_told(file):
    with pytest.raises(RobotError, match="'a_tilt' has no motor of its own"):
        arm_alone(file, load_robot(file, root="a_base", fixed={"a_lift": 0.1}))
    with pytest.raises(RobotError, match="read from text"):
        robot_spec(load_robot_from_string(URDF))


ONE = """<mujoco><compiler angle="radian" autolimits="true"/><default>{0}</default><worldbody><body name="a">
<joint name="a" axis="0 0 1" range="-1 1"/><geom size=".1"/><body name="b" pos=".3 0 0"><joint name="b" axis="0 0 1"
range="-1 1"/><geom size=".1"/><body name="c" pos=".3 0 0"><joint name="c" axis="0 0 1" range="-1 1"/><geom size=".1"/>
</body></body></body></worldbody><contact><exclude body1="a" body2="c"/></contact><tendon><fixed name="b">
<joint joint="c" coef="1"/></fixed></tendon><actuator>{1}<motor joint="b"/></actuator></mujoco>"""


@pytest.mark.parametrize("default", ['<motor gear="50"/>', '<position kp="100"/>', '<general ctrlrange="-1 1"/>'])
@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
def test_defaults_of_a_file_are_not_those_of_the_motors_that_are_added(default, tmp_path):
    given = '<general joint="a" biastype="affine" gear="2" forcerange="-5 5"/>'
    (tmp_path / "one.xml").write_text(ONE.format(default, given))
    robot = load_robot(tmp_path / "one.xml", fixed={"c": 0.0})
    assert arm_alone(tmp_path / "one.xml", robot).torque_limit[0] == 10.0


@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
def test_parts_of_one_name_and_another_kind_stay(tmp_path):
    """Joint c and the tendon called b go: the bodies' exclusion and the motor of joint b stay."""
    (tmp_path / "one.xml").write_text(ONE.format("", '<motor joint="a"/>'))
    spec = robot_spec(load_robot(tmp_path / "one.xml", fixed={"c": 0.0}))
    assert [(e.bodyname1, e.bodyname2) for e in spec.excludes] == [("a", "c")]
    assert [actuator.target for actuator in spec.actuators] == ["a", "b"]


def test_a_torque_of_one_sign_is_an_error(tmp_path):
    given = '<general joint="a" biastype="affine" forcerange="0 5"/>'
    (tmp_path / "one.xml").write_text(ONE.format("", given))
    with pytest.raises(RobotError, match="'a' may have torques from 0 to 5"):
        robot_spec(load_robot(tmp_path / "one.xml"))
