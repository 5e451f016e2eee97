"""The built-in Franka Emika Panda."""

import functools
import json
from pathlib import Path

from ._robot import Robot
from ._robot_record import record_from_dict

PANDA_MODEL = Path(__file__).parent / "models" / "panda.xml"
"""MJCF of the Panda with its hand: kinematics, inertias, primitive geometry, torque motors."""

PANDA_NUMBERS = PANDA_MODEL.with_suffix(".json")  # its kinematics as plain numbers, by `_make_panda_numbers`


@functools.cache
def panda() -> Robot:
    """The Franka Emika Panda with its hand, n = 7, both fingers fixed open at 0.04 m; needs no download, no MuJoCo.

    Frames: `panda_link0` to `panda_link8`, `panda_hand`, `panda_hand_tcp` (between the fingertips),
    `panda_leftfinger`, `panda_rightfinger`, `world`.
    """
    return record_from_dict(json.loads(PANDA_NUMBERS.read_text(encoding="utf-8"))).robot()
