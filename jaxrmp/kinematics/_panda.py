"""The built-in Franka Emika Panda."""

import dataclasses
import functools
from pathlib import Path

import numpy as np

from ._load import load_robot
from ._robot import Robot

PANDA_MODEL = Path(__file__).parent / "models" / "panda.xml"
"""MJCF of the Panda with its hand: kinematics, inertias, primitive geometry, torque motors."""


@functools.cache
def panda() -> Robot:
    """The Franka Emika Panda with its hand, n = 7, both fingers fixed open at 0.04 m; needs no download.

    Frames: `panda_link0` to `panda_link8`, `panda_hand`, `panda_hand_tcp` (between the fingertips),
    `panda_leftfinger`, `panda_rightfinger`, `world`.
    """
    robot = load_robot(PANDA_MODEL, fixed={"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04})
    limit = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])  # rad/s, manufacturer's figures
    return dataclasses.replace(robot, velocity_limit=limit)
