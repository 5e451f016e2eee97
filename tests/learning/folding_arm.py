"""An arm whose hand can fold back onto its forearm, elbow up, at poses that it has elbow down with nothing touching."""

import jax.numpy as jnp
import numpy as np

from jaxrmp._rotations import quaternion_of_rotation
from jaxrmp.kinematics import forward_kinematics
from jaxrmp.learning import PoseDemonstration, PoseDemonstrationSet

ARM = """
<mujoco model="folding">
  <compiler angle="radian"/>
  <worldbody>
    <body name="pan" pos="0 0 0.1">
      <joint name="pan" axis="0 0 1" range="-6 6"/>
      <geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.1"/>
      <body name="upper" pos="0 0 0.25">
        <joint name="lift" axis="0 -1 0" range="-3 3"/>
        <geom type="capsule" size="0.03" fromto="0.1 0 0 0.3 0 0"/>
        <body name="fore" pos="0.4 0 0">
          <joint name="elbow" axis="0 -1 0" range="-3 3"/>
          <geom type="capsule" size="0.03" fromto="0.1 0 0 0.3 0 0"/>
          <body name="wrist_1" pos="0.4 0 0">
            <joint name="wrist_1" axis="0 -1 0" range="-6 6"/>
            <body name="wrist_2">
              <joint name="wrist_2" axis="0 0 1" range="-6 6"/>
              <body name="hand">
                <joint name="wrist_3" axis="1 0 0" range="-6 6"/>
                <geom type="capsule" size="0.03" fromto="0.1 0 0 0.2 0 0"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
FOLDED = np.array([0.1, 1.2, -1.6, 2.9, 0.1, 0.0])  # elbow up, the hand back on the forearm
OPEN = np.array([0.1, -0.4, 1.6, 1.3, 0.1, 0.0])  # the hand at the same pose, elbow down


def folding_arm(folder, text=ARM):
    """The path of its file."""
    (folder / "folding.xml").write_text(text)
    return folder / "folding.xml"


def poses_of_hand(robot, q):
    """Demonstrations of the hand that goes aside and up by some centimetres, from near where it is at `q` [n]."""
    T = np.asarray(forward_kinematics(robot, jnp.asarray(q), "hand"), float)
    s = np.linspace(0, 1, 60)[:, None]
    demonstrations = []
    for k in range(3):
        position = T[:3, 3] + s * [0.0, 0.1, 0.05] + (1 - s) * [0.0, 0.01 * k, 0.0]
        turn = np.tile(quaternion_of_rotation(T[:3, :3]), (len(s), 1))
        demonstrations.append(PoseDemonstration(3 * s[:, 0], position, turn))
    return PoseDemonstrationSet(tuple(demonstrations), "folding")
