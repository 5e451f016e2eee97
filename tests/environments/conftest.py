"""A planar arm whose hand is stopped by a ball on its straight way."""

import numpy as np
import pytest

from jaxrmp._pytree import single
from jaxrmp.environments import ResidualEnvironment
from jaxrmp.kinematics import load_robot_from_string
from jaxrmp.policies import reaching_policy
from jaxrmp.world import RobotSpheres, Spheres, World

ARM = """
<mujoco model="planar">
  <compiler angle="radian" autolimits="true"/>
  <default><joint axis="0 0 1" range="-2.6 2.6"/><geom type="capsule" size="0.03"/></default>
  <worldbody>
    <body name="upper"><joint name="shoulder"/><geom fromto="0 0 0 0.4 0 0"/>
      <body name="fore" pos="0.4 0 0"><joint name="elbow"/><geom fromto="0 0 0 0.3 0 0"/>
        <body name="hand" pos="0.3 0 0"><joint name="wrist"/><geom fromto="0 0 0 0.2 0 0"/>
          <site name="tip" pos="0.2 0 0"/></body></body></body>
  </worldbody>
</mujoco>"""
START = np.array([-0.9, 0.9, 0.5], np.float32)


@pytest.fixture(scope="session")
def environment():
    robot = load_robot_from_string(ARM)
    spheres = RobotSpheres(("hand", "tip"), np.array([[0.1, 0, 0], [0, 0, 0]]), np.array([0.04, 0.03]))
    policy = reaching_policy(robot, "tip", START, spheres, self_collision=False)
    goal = np.eye(4, dtype=np.float32)
    goal[:2, 3] = 0.5, 0.35
    ball = World(spheres=Spheres.of([((0.62, 0.05, 0.0), 0.1)], capacity=2))
    limits = np.full(3, 20.0), np.full(3, 60.0)
    return single(ResidualEnvironment(policy, START, goal, ball, *limits, spread=0.1, target_spread=0.02, length=20))
