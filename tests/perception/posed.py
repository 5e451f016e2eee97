"""A small arm of boxes, a capsule and a mesh, and what a camera sees of it in some postures."""

import numpy as np

from jaxrmp.kinematics import load_robot
from jaxrmp.perception import KINECT, Camera, depth_renderer, measured_depth

ARM = """
<mujoco model="small_arm">
  <compiler angle="radian"/>
  <asset><mesh name="wedge" vertex="-.05 -.04 0 .05 -.04 0 -.05 .04 0 .05 .04 0 -.02 0 .16 .06 0 .16"/></asset>
  <worldbody>
    <body name="base"><geom type="box" size="0.08 0.06 0.05" pos="0 0 0.05"/>
      <body name="one" pos="0 0 0.1"><joint name="a" axis="0 0 1" range="-3 3"/>
        <geom type="box" size="0.05 0.04 0.12" pos="0 0 0.12"/>
        <body name="two" pos="0 0.05 0.24"><joint name="b" axis="0 1 0" range="-2 2"/>
          <geom type="capsule" size="0.035" fromto="0 0 0 0 0 0.22"/>
          <geom type="box" size="0.06 0.02 0.03" pos="0 0.04 0.2"/>
          <body name="three" pos="0 0 0.26"><joint name="c" axis="0 1 0" range="-2 2"/>
            <geom type="mesh" mesh="wedge"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
POST = """
<mujoco model="post"><worldbody><body name="post"><joint name="turn" axis="0 0 1" range="-3 3"/>
<geom type="cylinder" size="0.08 0.3" pos="0 0 0.3"/></body></worldbody></mujoco>
"""
POSTURES = np.array([[0.0, 0.3, 0.5], [0.9, -0.8, 1.0], [-1.2, 0.9, -0.6], [2.0, 0.5, 1.2], [-2.2, -0.5, -1.0]])


def camera(width=320, height=240):
    return Camera.looking([0.75, 0.5, 0.65], [0.0, 0.0, 0.3], width, height)


def robot_of(text, folder):
    file = folder / "robot.xml"
    file.write_text(text)
    return load_robot(file)


def images(text, q, eye, seed=0, noise=KINECT):
    """Depth images [N, height, width] of the robot on a floor, in postures `q` [N, n]."""
    import mujoco

    things = '<geom type="plane" size="3 3 .1" pos="0 0 -.005"/><geom type="box" size=".1 .1 .1" pos="-.5 0 0"/>'
    buffer = '<visual><global offwidth="640" offheight="480"/><map znear=".01" zfar="50"/></visual>'
    floor = f'{buffer}<statistic extent="1"/><worldbody>{things}'
    m = mujoco.MjModel.from_xml_string(text.replace("<worldbody>", floor, 1))
    data, rng, found = mujoco.MjData(m), np.random.default_rng(seed), []
    with depth_renderer(m, eye.width, eye.height) as render:
        for one in q:
            data.qpos[:] = one
            mujoco.mj_kinematics(m, data)
            mujoco.mj_camlight(m, data)
            found.append(measured_depth(noise, render(data, eye), rng))
    return np.stack(found)
