"""Writes `models/panda.json`, the kinematics of `models/panda.xml` as plain numbers: after every change of that.

python -m jaxrmp.kinematics._make_panda_numbers
"""

import json
from dataclasses import replace

import numpy as np

from ._load import load_robot
from ._panda import PANDA_MODEL, PANDA_NUMBERS
from ._robot import Robot
from ._robot_record import record_of, record_to_dict

_VELOCITY = (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)  # rad/s, manufacturer's figures


def panda_of_its_file() -> Robot:
    """The built-in Panda as MuJoCo reads its file, both fingers fixed open at 0.04 m."""
    robot = load_robot(PANDA_MODEL, fixed={"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04})
    return replace(robot, velocity_limit=np.array(_VELOCITY))


if __name__ == "__main__":
    content = record_to_dict(record_of(panda_of_its_file()))
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items()]
    PANDA_NUMBERS.write_text("{\n" + ",\n".join(lines).replace("}, {", "},\n  {") + "\n}\n", encoding="utf-8")
