"""`jaxrmp export`: a skill as a file that other programs run."""

import argparse
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from .._pytree import single
from .._tree import acceleration
from ..export import write_stablehlo
from ..kinematics import Robot
from ..learning import Skill
from ._output import tell
from ._sources import skill_and_robot


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    skill, robot = skill_and_robot(arguments.skill, arguments.robot)
    file = write_stablehlo(arguments.stablehlo, *policy_of(skill, robot))
    tell(f"wrote {file}: accelerations of {robot.num_joints} joints, of q, qd and T_world_object.")


def policy_of(skill: Skill, robot: Robot) -> tuple[Callable[..., Any], np.ndarray, np.ndarray, np.ndarray]:
    """A skill as a function of `q` [n], `qd` [n] and `T_world_object` [4, 4], that returns `qdd` [n]; and examples."""
    whole = single(skill)

    def policy(q: jax.Array, qd: jax.Array, T_world_object: jax.Array) -> jax.Array:
        return acceleration(whole.tree(robot, T_world_object), q, qd)

    zeros = np.zeros(robot.num_joints, np.float32)
    return policy, zeros, zeros, np.asarray(skill.T_world_object, np.float32)
