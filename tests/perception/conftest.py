"""A small cabinet with a door and a drawer, of all kinds of shapes, and what a camera sees of it."""

import numpy as np

from jaxrmp.perception import Camera, object_model

MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <visual><global offwidth="640" offheight="480"/></visual>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1"/>
    <body name="object" mocap="true" pos="0.1 -0.05 0.4">
      <geom name="top" type="box" size="0.3 0.2 0.01" pos="0 0.2 0.2"/>
      <geom name="left" type="box" size="0.01 0.2 0.2" pos="-0.29 0.2 0"/>
      <geom name="right" type="box" size="0.01 0.2 0.2" pos="0.29 0.2 0"/>
      <body name="door" pos="0.3 -0.02 0">
        <joint name="hinge" type="hinge" axis="0 0 1" range="-0.2 1.5" pos="0 0.01 0"/>
        <geom name="panel" type="box" size="0.2 0.01 0.18" pos="-0.2 0 0"/>
        <geom name="bar" type="capsule" size="0.012" fromto="-0.36 -0.05 -0.08 -0.36 -0.05 0.08"/>
        <geom name="knob" type="sphere" size="0.03" pos="-0.1 -0.02 0.1"/>
      </body>
      <body name="drawer" pos="-0.2 -0.02 0">
        <joint name="slide" type="slide" axis="0 -1 0" range="0 0.2"/>
        <geom name="front" type="box" size="0.08 0.01 0.1"/>
        <geom name="pull" type="cylinder" size="0.02 0.015" pos="0 -0.025 0.05" euler="1.5707963 0 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
T_WORLD_OBJECT = np.array([[1.0, 0, 0, 0.1], [0, 1, 0, -0.05], [0, 0, 1, 0.4], [0, 0, 0, 1]])


def model_and_data(hinge=0.5, slide=0.08):
    import mujoco

    m = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(m)
    put(m, data, hinge, slide)
    return m, data


def put(m, data, hinge, slide, T=T_WORLD_OBJECT):
    import mujoco

    data.mocap_pos[0] = T[:3, 3]
    mujoco.mju_mat2Quat(data.mocap_quat[0], np.ascontiguousarray(T[:3, :3]).ravel())
    data.joint("hinge").qpos[0], data.joint("slide").qpos[0] = hinge, slide
    mujoco.mj_kinematics(m, data)
    mujoco.mj_camlight(m, data)


def camera(width=320, height=240):
    return Camera.looking([-0.3, -1.1, 1.1], [0.1, 0.0, 0.4], width, height)


def thing(m, points=1200):
    return object_model(m, "object", points, sets=4)
