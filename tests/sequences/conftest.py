"""A planar arm with two fingers, a puck on a table, and a sequence that carries it."""

import mujoco
import numpy as np
import pytest

from jaxrmp import scenes, sequences
from jaxrmp._rotations import pose, rotation_of_vector
from jaxrmp.kinematics import load_robot_from_string

START = np.array([2.2, -1.9, -0.3])
ARM = """
<mujoco model="gripping">
  <compiler angle="radian" autolimits="true"/>
  <default><joint axis="0 0 1" range="-2.6 2.6" armature="0.05" damping="0.5"/><geom type="capsule" size="0.03"/>
  </default>
  <worldbody>
    <body name="upper" pos="0 0 0.3"><joint name="shoulder"/><geom fromto="0 0 0 0.4 0 0"/>
      <body name="fore" pos="0.4 0 0"><joint name="elbow"/><geom fromto="0 0 0 0.3 0 0"/>
        <body name="hand" pos="0.3 0 0"><joint name="wrist"/><geom fromto="0 0 0 0.1 0 0"/>
          <site name="grip" pos="0.2 0 0"/>
          <body name="left" pos="0.18 0.005 0">
            <joint name="left" type="slide" axis="0 1 0" range="0 0.05" damping="20"/>
            <geom type="box" size="0.05 0.005 0.015" mass="0.05" friction="2"/></body>
          <body name="right" pos="0.18 -0.005 0">
            <joint name="right" type="slide" axis="0 -1 0" range="0 0.05" damping="20"/>
            <geom type="box" size="0.05 0.005 0.015" mass="0.05" friction="2"/></body>
        </body></body></body>
  </worldbody>
  <contact><exclude body1="left" body2="right"/><exclude body1="left" body2="hand"/>
    <exclude body1="right" body2="hand"/></contact>
  <actuator>
    <motor joint="shoulder" ctrlrange="-40 40"/><motor joint="elbow" ctrlrange="-40 40"/>
    <motor joint="wrist" ctrlrange="-20 20"/>
    <position name="left" joint="left" kp="400" ctrlrange="0 0.05"/>
    <position name="right" joint="right" kp="400" ctrlrange="0 0.05"/>
  </actuator>
</mujoco>"""
FINGERS = scenes.Gripper(("left", "right"), widest=0.1, open=0.05, joints=("left", "right"))


def at(x, y, z=0.0, yaw=0.0):
    return pose(np.array([x, y, z]), rotation_of_vector(np.array([0.0, 0.0, yaw])))


@pytest.fixture(scope="session")
def gripping():
    return load_robot_from_string(ARM, fixed={"left": 0.05, "right": 0.05})


@pytest.fixture(scope="session")
def table(gripping):
    """The scene; its fingers are driven."""
    spec = mujoco.MjSpec.from_string(ARM)
    box = mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_geom(name="table", type=box, size=[1, 1, 0.01], pos=[0, 0, 0.27], contype=0, conaffinity=2)
    puck = spec.worldbody.add_body(name="puck", pos=[0.45, 0.35, 0.3])
    puck.add_freejoint()
    puck.add_geom(name="puck", type=box, size=[0.02] * 3, mass=0.05, contype=3, friction=[1.5, 0.01, 0.001])
    settings = {"robot": gripping, "hand": "grip", "object": "puck", "may_touch": ("puck",), "gripper": FINGERS}
    return scenes.Scene("table", spec, T_world_object=at(0.45, 0.35, 0.3), **settings)


@pytest.fixture(scope="session")
def reaching(gripping):
    """`reaching(name, T, ...)`: a state that takes the grip there, from `START`."""

    def reaching(name, T, guard=sequences.Arrived(), **settings):  # noqa: B008
        with pytest.warns(UserWarning, match="avoids neither"):  # it was read from no file
            return sequences.reach(name, gripping, "grip", T, guard, rest=START, **settings)

    return reaching
