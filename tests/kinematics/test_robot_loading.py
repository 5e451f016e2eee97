"""Reading robots from MJCF and URDF: structure, limits, couplings, locked joints, identity, and typed errors."""

import copy
import dataclasses
import pickle
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp._errors import RobotError, ShapeError, UnknownNameError
from jaxrmp.kinematics import Robot, forward_kinematics, load_robot, load_robot_from_string, panda
from jaxrmp.kinematics._robot import KinematicModel

MODELS = Path(__file__).parent / "models"


def mjcf(body="", equality="", more=""):
    return f"""<mujoco model="m"><worldbody><body name="a"><joint name="j1" type="hinge" axis="0 0 1"/>
      <geom size="1"/><body name="b" pos="1 0 0"><joint name="j2" type="slide" axis="1 0 0" range="0 1"/>
      <geom size="1"/>{body}</body></body></worldbody><equality>{equality}</equality>{more}</mujoco>"""


def test_panda_is_the_published_arm():
    robot = panda()
    assert robot is panda()
    assert robot.joint_names == tuple(f"panda_joint{i}" for i in range(1, 8))
    assert robot.num_joints == 7
    np.testing.assert_array_equal(robot.lower, [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
    np.testing.assert_array_equal(robot.upper, [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
    np.testing.assert_array_equal(robot.velocity_limit, [2.175] * 4 + [2.61] * 3)
    assert robot.lower.dtype == np.float64
    for name in (*(f"panda_link{i}" for i in range(9)), "panda_hand", "panda_leftfinger", "panda_rightfinger"):
        assert robot.frame_names[robot.frame_index(name)] == name


def test_urdf_without_meshes_or_inertias():
    robot = load_robot(MODELS / "arm.urdf")
    assert robot.name == "small_arm"
    assert robot.joint_names == ("turn", "raise", "extend", "roll")
    np.testing.assert_allclose(robot.lower, [-np.inf, -1.2, 0, -2])
    np.testing.assert_allclose(robot.upper, [np.inf, 1.1, 0.5, 2])
    np.testing.assert_allclose(robot.velocity_limit, [np.inf, 1.5, 0.25, 3])
    assert {"world", "base", "tool", "finger"} <= set(robot.frame_names)


def test_urdf_mimic_joint_follows_its_leader():
    robot = load_robot(MODELS / "arm.urdf")
    with jax.enable_x64(True):
        q = jnp.array([0.3, -0.4, 0.2, 1.0])
        T_world_tool, T_world_finger = (forward_kinematics(robot, q, name) for name in ("tool", "finger"))
        np.testing.assert_allclose(
            T_world_finger, T_world_tool @ _translation(0, 0.01 + 0.5 * 0.2 + 0.01, 0), atol=1e-14
        )


def _translation(x, y, z):
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def test_velocity_limits_of_a_urdf_with_undeclared_prefixes_are_not_lost_silently():
    text = (MODELS / "arm.urdf").read_text().replace('<link name="base"/>', '<link name="base"/><x:y/>')
    with pytest.raises(RobotError, match="not well-formed XML"):
        load_robot_from_string(text)


@pytest.mark.parametrize("name", ["arm.urdf", "branching.xml"])
def test_locked_joints_are_constants(name):
    free = load_robot(MODELS / name)
    values = dict(zip(free.joint_names, 0.1 + 0.05 * np.arange(free.num_joints), strict=True))
    locked_names = free.joint_names[1::2]
    locked = load_robot(MODELS / name, fixed={joint: values[joint] for joint in locked_names}, name="locked")
    assert locked.name == "locked"
    assert locked.joint_names == tuple(j for j in free.joint_names if j not in locked_names)
    np.testing.assert_array_equal(locked.upper, [free.upper[free.joint_index(j)] for j in locked.joint_names])
    with jax.enable_x64(True):
        q, q_locked = (jnp.array([values[j] for j in robot.joint_names]) for robot in (free, locked))
        for frame in free.frame_names:
            expected = forward_kinematics(free, q, frame)
            np.testing.assert_allclose(forward_kinematics(locked, q_locked, frame), expected, atol=1e-13)


def test_locking_a_mimic_joint_locks_its_leader():
    robot = load_robot(MODELS / "arm.urdf", fixed={"grip": 0.11})
    assert robot.joint_names == ("turn", "raise", "roll")
    (extend,) = (joint for joint in robot.model.joints if joint.name == "extend")
    assert extend.offset == pytest.approx(0.2)
    with pytest.raises(RobotError, match=r"fixed\['extend'\] is 0.3, but the coupling .* puts it at 0.2"):
        load_robot(MODELS / "arm.urdf", fixed={"grip": 0.11, "extend": 0.3})


def test_fixed_values_are_checked():
    with pytest.raises(UnknownNameError, match=r"unknown joint 'rise'\. Did you mean 'raise'"):
        load_robot(MODELS / "arm.urdf", fixed={"rise": 0.0})
    with pytest.raises(RobotError, match=r"fixed\['raise'\] is 2.0, outside the joint's range \[-1.2, 1.1\]"):
        load_robot(MODELS / "arm.urdf", fixed={"raise": 2.0})
    with pytest.raises(RobotError, match="expected a finite number"):
        load_robot(MODELS / "arm.urdf", fixed={"turn": np.nan})
    with pytest.raises(RobotError, match="no joint is left to move"):
        load_robot_from_string(mjcf(), fixed={"j1": 0.0, "j2": 0.5})


def test_a_coupling_to_nothing_locks_the_joint():
    robot = load_robot_from_string(mjcf(equality='<joint joint1="j2" polycoef="0.25 0 0 0 0"/>'))
    assert robot.joint_names == ("j1",)
    np.testing.assert_allclose(forward_kinematics(robot, jnp.zeros(1), "b")[0, 3], 1.25)


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        (mjcf(body='<body name="c"><joint name="tumble" type="ball"/></body>'), "joint 'tumble' of body 'c' is a ball"),
        (mjcf().replace('type="hinge" axis="0 0 1"', 'type="free"'), "joint 'j1' of body 'a' is a free joint"),
        (
            mjcf(equality='<joint joint1="j2" joint2="j1" polycoef="0 1 0.5 0 0"/>'),
            "joint 'j2' follows 'j1' by the polynomial",
        ),
        (
            mjcf(equality='<joint joint1="j2" joint2="j1"/><joint joint1="j1" joint2="j2"/>'),
            "follow each other in a circle",
        ),
        (
            mjcf(equality='<joint joint1="j2" joint2="j1"/>' * 2),
            "joint 'j2' follows more than one joint",
        ),
        (
            mjcf(equality='<connect name="loop" body1="b" anchor="0 0 0"/>'),
            r"equality 'loop' closes a loop through joints \['j1', 'j2'\]",
        ),
        ("<mujoco><worldbody><body/></worldbody></mujoco>", "no joint is left to move"),
        ("<mujoco><worldbdy/></mujoco>", "cannot be read as MJCF or URDF"),
        ("", "cannot be read as MJCF or URDF"),
        (
            "<robot name='r'><link name='a'/><joint name='j' type='revolute'/></robot>",
            "the parent of joint 'j' is None",
        ),
    ],
)
def test_what_cannot_be_a_robot_is_refused(xml, message):
    with pytest.raises(RobotError, match=message):
        load_robot_from_string(xml)


def test_closed_loops_are_fine_once_locked_and_when_they_only_drag_the_robot():
    loop = '<connect name="loop" body1="b" body2="a" anchor="0 0 0"/>'
    assert load_robot_from_string(mjcf(equality=loop), fixed={"j2": 0.5}).joint_names == ("j1",)
    drag = mjcf(equality='<weld body1="hand" body2="b"/>').replace(
        '<body name="a">', '<body name="hand" mocap="true"/><body name="a">'
    )
    assert load_robot_from_string(drag).joint_names == ("j1", "j2")


def test_unreadable_files_are_named(tmp_path):
    with pytest.raises(RobotError, match=r"absent\.urdf: there is no such file"):
        load_robot(tmp_path / "absent.urdf")
    with pytest.raises(RobotError, match="this is a folder"):
        load_robot(tmp_path)
    path = tmp_path / "broken.xml"
    path.write_bytes(b"\x00\xff<mujoco")
    with pytest.raises(RobotError, match=r"broken\.xml cannot be read as MJCF or URDF"):
        load_robot(path)


def test_models_are_compared_by_content_and_hash_the_same_in_every_process():
    first, second = load_robot(MODELS / "arm.urdf"), load_robot(MODELS / "arm.urdf")
    assert first.model is not second.model
    assert first.model == second.model and hash(first.model) == hash(second.model)
    assert first.model != load_robot(MODELS / "branching.xml").model
    assert pickle.loads(pickle.dumps(first.model)) == first.model == copy.deepcopy(first.model)
    moved = dataclasses.replace(
        first.model, bodies=(*first.model.bodies[:-1], first.model.bodies[-1]._replace(position=(0.0, 0.01, 1e-12)))
    )
    assert moved != first.model
    code = f"from jaxrmp.kinematics import load_robot; print(load_robot({str(MODELS / 'arm.urdf')!r}).fingerprint)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == [first.fingerprint]


def test_fingerprint_tells_robots_apart_but_not_their_limits_or_names():
    robot = load_robot(MODELS / "arm.urdf")
    assert len(robot.fingerprint) == 16
    assert robot.fingerprint == load_robot(MODELS / "arm.urdf", name="other").fingerprint
    assert robot.fingerprint == dataclasses.replace(robot, upper=robot.upper * 0.5).fingerprint
    assert robot.fingerprint != load_robot(MODELS / "arm.urdf", fixed={"roll": 0.0}).fingerprint
    bodies = robot.model.bodies
    longer = (*bodies[:-1], bodies[-1]._replace(position=(0.0, 0.011, 0.0)))
    assert dataclasses.replace(robot.model, bodies=longer).fingerprint != robot.fingerprint
    assert panda().fingerprint == "a94f8b2b1771cfec"  # skill files hold it: a change makes them refuse the robot


def test_robot_is_a_pytree_of_its_limits():
    robot = panda()
    assert len(jax.tree.leaves(robot)) == 3
    assert isinstance(robot.model, KinematicModel)
    assert jax.tree.map(lambda x: 2 * x, robot).upper[0] == 2 * 2.8973
    with pytest.raises(ShapeError, match=r"lower has shape \(6,\), expected \(7,\)"):
        Robot(np.zeros(6), robot.upper, robot.velocity_limit, robot.model)
    with pytest.raises(UnknownNameError, match=r"panda_finger_joint1.*has no coordinate"):
        robot.joint_index("panda_finger_joint1")
    assert robot.joint_index("panda_joint3") == 2
