"""One robot of a file that holds more, where it stands, what it holds, and what of it is locked."""

import jax
import numpy as np
import pytest

import jaxrmp
from jaxrmp.kinematics import forward_kinematics, load_robot, load_robot_from_string
from jaxrmp.policies import reaching_policy
from jaxrmp.world import World, own_self_pairs, own_spheres

ARM = """<body name="{0}_base" pos="{1} 0 0"><body name="{0}_upper" pos="0 0 .3">
<joint name="{0}_pan" axis="0 0 1" range="-2 2"/><geom size=".05"/><body name="{0}_hand" pos=".4 0 0">
<joint name="{0}_tilt" axis="0 1 0" range="-1 1"/><geom size=".04"/>
<body name="{0}_left"><joint name="{0}_finger_1" type="slide" axis="0 1 0" range=".01 .04"/><geom size=".01"/></body>
<body name="{0}_right"><joint name="{0}_finger_2" type="slide" axis="0 -1 0" range=".01 .04"/><geom size=".01"/></body>
</body></body></body>"""
BOTH = f"""<mujoco model="both"><compiler angle="radian" autolimits="true"/><worldbody>
<body name="lift" pos="0 0 .5"><joint name="lift" type="slide" axis="0 0 1" range="0 .5"/><geom size=".05"/>
{ARM.format("a", 0.2)}{ARM.format("b", -0.2)}</body>
<body name="cup" pos="1 0 0"><freejoint name="cup"/><geom size=".03"/></body></worldbody>
<contact><exclude body1="a_hand" body2="b_hand"/><exclude body1="b_upper" body2="b_left"/>
<exclude body1="b_upper" body2="b_right"/></contact>
<equality><joint joint1="a_finger_2" joint2="a_finger_1"/><joint joint1="b_finger_2" joint2="b_finger_1"/></equality>
</mujoco>"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "both.xml").write_text(BOTH)
    return tmp_path / "both.xml"


def test_objects_that_lie_free_beside_a_robot_are_left_out_and_named():
    with pytest.warns(jaxrmp.FileWarning, match="cup"):
        robot = load_robot_from_string(BOTH)
    assert robot.joint_names == ("lift", "a_pan", "a_tilt", "a_finger_1", "b_pan", "b_tilt", "b_finger_1")
    assert "cup" not in robot.frame_names
    with pytest.raises(jaxrmp.RobotError, match="free joint"):  # nothing else moves: it is the robot
        load_robot_from_string('<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>')


def test_one_arm_of_two_on_a_column_that_stands_still_or_is_put_somewhere(file):
    robot = load_robot(file, root="b_base", fixed={"*_finger_*": None})
    assert robot.joint_names == ("b_pan", "b_tilt") and not any(name.startswith("a_") for name in robot.frame_names)
    hand = forward_kinematics(robot, np.zeros(2), "b_hand")
    np.testing.assert_allclose(hand[:3, 3], [0.2, 0, 0.8], atol=1e-6)
    raised = load_robot(file, root="b_base", fixed={"*_finger_*": 0.02, "lift": 0.3})
    np.testing.assert_allclose(forward_kinematics(raised, np.zeros(2), "b_hand")[:3, 3], [0.2, 0, 1.1], atol=1e-6)
    with pytest.raises(jaxrmp.UnknownNameError, match="b_base"):
        load_robot(file, root="c_base")


def test_a_joint_above_the_root_that_stays_where_its_limits_forbid_it_is_told(tmp_path):
    (tmp_path / "high.xml").write_text(BOTH.replace('range="0 .5"', 'range=".1 .5"'))
    with pytest.warns(jaxrmp.FileWarning, match=r"'lift' above the root stays at 0, outside of its limits from 0.1"):
        load_robot(tmp_path / "high.xml", root="b_base")


def test_a_file_may_have_keyframes_of_all_that_is_in_it(tmp_path):
    key = f'<keyframe><key name="home" qpos="{"0 " * 9} 0 0 0 1 0 0 0"/></keyframe></mujoco>'
    (tmp_path / "keys.xml").write_text(BOTH.replace("</mujoco>", key))
    assert load_robot(tmp_path / "keys.xml", root="b_base").num_joints == 3
    with pytest.warns(jaxrmp.FileWarning, match="cup"):
        assert load_robot(tmp_path / "keys.xml").num_joints == 7


def test_one_arm_of_two_is_covered_and_reaches(file):
    robot = load_robot(file, root="b_base", fixed={"*_finger_*": None})
    policy = reaching_policy(robot, "b_hand")
    assert {name[0] for name in policy.spheres.frames} == {"b"}
    whole = own_spheres(robot)
    meet = {frozenset((whole.frames[i], whole.frames[j])) for i, j in own_self_pairs(robot, whole)}
    assert meet == {frozenset(("lift", name)) for name in ("b_hand", "b_left", "b_right")}
    tree = policy.tree(np.eye(4), World())
    assert np.isfinite(jax.jit(jaxrmp.acceleration)(tree, np.full(2, 0.1), np.zeros(2))).all()


def test_a_joint_whose_leader_is_left_out_must_be_locked():
    two = """<mujoco><worldbody><body name="a"><joint name="a" axis="0 0 1"/><geom size=".1"/></body>
    <body name="b"><joint name="b" axis="0 0 1"/><geom size=".1"/><body name="c"><joint name="c" axis="0 0 1"/>
    <geom size=".1"/></body></body></worldbody><equality><joint joint1="c" joint2="a"/></equality></mujoco>"""
    with pytest.raises(jaxrmp.RobotError, match="'c' follows 'a'"):
        load_robot_from_string(two, root="b")
    assert load_robot_from_string(two, root="b", fixed={"c": 0.1}).joint_names == ("b",)
    links = "".join(f'<link name="{name}"/>' for name in ("base", "a", "b", "c"))
    joint = '<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{0}"/>{2}</joint>'
    mimic = '<mimic joint="a"/>'
    joints = joint.format("a", "base", "") + joint.format("b", "base", "") + joint.format("c", "b", mimic)
    urdf = f'<robot name="two">{links}{joints}</robot>'
    with pytest.raises(jaxrmp.RobotError, match="'c' follows 'a'"):
        load_robot_from_string(urdf, root="b")
    assert load_robot_from_string(urdf, root="b", fixed={"c": 0.1}).joint_names == ("b",)


@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
def test_joints_are_locked_by_pattern(file):
    robot = load_robot(file, fixed={"*_finger_*": None, "a_finger_1": 0.03, "[b]_pan": 0.5})
    assert robot.joint_names == ("lift", "a_pan", "a_tilt", "b_tilt")
    held = {joint.name: joint.offset for joint in robot.model.joints if joint.coordinate < 0}
    assert held["a_finger_1"] == held["a_finger_2"] == 0.03 and held["b_finger_1"] == 0.01 and held["b_pan"] == 0.5
    with pytest.raises(jaxrmp.UnknownNameError, match="claw"):
        load_robot(file, fixed={"*_claw_*": None})


@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
def test_a_robot_file_says_where_it_stands_and_what_it_holds(file):
    described = file.with_name("left.toml")
    described.write_text(
        'file = "both.xml"\nroot = "a_base"\nname = "left"\nmount = [0, 0, 1, 0, 0, 1.5707963267948966]\n'
        '[fixed]\n"*finger*" = 0.02\n[tools.tcp]\nframe = "a_hand"\npose = [0.1, 0, 0]\n'
    )
    robot = load_robot(described)
    assert robot.name == "left" and robot.joint_names == ("a_pan", "a_tilt") and robot.frame_names[-1] == "tcp"
    q = np.array([0.2, 0.3])
    with jax.enable_x64(True):
        T = forward_kinematics(robot, q, "tcp")
        plain = forward_kinematics(load_robot(file, root="a_base", fixed={"*finger*": 0.02}), q, "a_hand")
    turn = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]])
    shift = np.eye(4)
    shift[0, 3] = 0.1
    np.testing.assert_allclose(T, turn @ plain @ shift, atol=1e-9)
    assert load_robot(described, fixed={"a_pan": 0.1}).joint_names == ("a_tilt",)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("file = 3", "file"),
        ("", "file"),
        ('file = "both.xml"\nmount = [1, 2]', "mount"),
        ('file = "both.xml"\n[tools.tcp]\nframe = "a_hand"', "tools.tcp"),
        ('file = "both.xml"\n[tools.a_hand]\nframe = "a_hand"\npose = [0, 0, 0]', "another name"),
        ('file = "absent.xml"', "absent.xml"),
        ('file = "both.xml"\nfix = 1', "fixed"),
        ("file = ", "TOML"),
        ('file = "robot.toml"', "expected the path of an MJCF or URDF file"),
        ('file = "both.xml"\nroot = 5', "root is 5, expected a string"),
        ('file = "both.xml"\npackages = {a = 5}', "packages.a is 5, expected a folder"),
        ('file = "both.xml"\nignore = {a_hand = ["a_foot"]}', "unknown frame in ignore 'a_foot'"),
        ('file = "both.xml"\nignore = {a_hand = "a_left"}', "ignore.a_hand is 'a_left', expected a list"),
        ('file = "both.xml"\ncover_error = "fine"', "cover_error is 'fine', expected a length"),
        ('file = "both.xml"\ncover_error = 0', "cover_error of load_robot is 0.0, expected"),
        ('file = "both.xml"\nfixed = {a_pan = "left"}', "fixed.'a_pan'. is 'left', expected a finite number"),
    ],
)
@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
def test_robot_files_that_are_wrong(text, named, file):
    described = file.with_name("robot.toml")
    described.write_text(text)
    with pytest.raises(jaxrmp.JaxrmpError, match=named):
        load_robot(described)


@pytest.mark.parametrize("pose", [np.eye(3), 2 * np.eye(4), np.diag([1.0, 1, -1, 1])])
def test_poses_that_are_none(pose, file):
    with pytest.raises(jaxrmp.RigidTransformError):
        load_robot(file, root="a_base", mount=pose)


def test_a_pattern_locks_joints_above_the_root_too(file):
    one, other = (load_robot(file, root="b_base", fixed={lift: 0.3}) for lift in ("lift", "li*"))
    assert one.joint_names == other.joint_names
    heights = [np.asarray(forward_kinematics(r, np.zeros(r.num_joints), "b_base"))[2, 3] for r in (one, other)]
    np.testing.assert_allclose(heights, 0.8, rtol=1e-6)


def test_links_without_names_keep_their_own_spheres_and_their_side(tmp_path):
    ball = '<body><freejoint/><geom size=".5"/></body>'
    hinge = '<joint axis="0 0 1" range="-1 1"/>'
    arm = f'<body>{hinge}<geom size=".3"/><body pos="1 0 0">{hinge}<geom size=".1"/></body></body>'
    path = tmp_path / "robot.xml"
    path.write_text(f"<mujoco><worldbody>{ball}{arm}</worldbody></mujoco>")
    with pytest.warns(jaxrmp.FileWarning, match="'body_1'.* lie free beside"):
        robot = load_robot(path)
    spheres = own_spheres(robot)
    assert dict(zip(spheres.frames, spheres.radii.tolist(), strict=True)) == {"body_2": 0.3, "body_3": 0.1}
    assert robot.joint_names == ("joint_1", "joint_2")  # the ball's is the first of the file
    two = f'<mujoco><worldbody><body>{arm}<body name="right">{hinge}</body></body></worldbody></mujoco>'
    assert load_robot_from_string(two, root="right").num_joints == 1
    with pytest.raises(jaxrmp.RobotError, match="one body is called 'body_2', and one without a name would be"):
        load_robot_from_string(two.replace('"right"', '"body_2"'))


def test_links_without_names_may_be_such_as_never_touch(tmp_path):
    path = tmp_path / "robot.xml"
    link = '<body pos=".5 0 0"><joint axis="0 1 0" range="-1 1"/><geom size=".1" contype="{}" conaffinity="0"/>'
    path.write_text(f"<mujoco><worldbody>{''.join(map(link.format, (1, 2, 4)))}{'</body>' * 3}</worldbody></mujoco>")
    robot = load_robot(path)
    assert own_self_pairs(robot, own_spheres(robot)) == ()
