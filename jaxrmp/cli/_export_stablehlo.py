"""A skill on its arm as a program of StableHLO."""

from pathlib import Path

import jax
import numpy as np

from .._tree import acceleration
from ..export import write_stablehlo
from ..kinematics import Robot
from ..learning import Skill
from ..policies import whole_arm_policy
from ..world import World


def write_skill_stablehlo(skill: Skill, robot: Robot, file: Path) -> Path:
    """Write the `whole_arm_policy` of a skill, without obstacles, as a program from `q` [n], `qd` [n] and
    `T_world_object` [4, 4] to `qdd` [n], in single precision. **Raises** as that and `write_stablehlo`."""
    policy = whole_arm_policy(skill, robot)

    def whole(q: jax.Array, qd: jax.Array, T_world_object: jax.Array) -> jax.Array:
        return acceleration(policy.tree(T_world_object, World()), q, qd)

    zeros = np.zeros(robot.num_joints, np.float32)
    return write_stablehlo(file, whole, zeros, zeros, np.eye(4, dtype=np.float32))
