"""A skill that is made without learning, as small as one can be."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp.kinematics import ControlPoints, forward_kinematics, panda
from jaxrmp.learning import Configuration, Skill, Subtask, initial_cholesky_factor, support_of_samples
from jaxrmp.leaves import Damping, JointLimit, Learned, NominalPotential

HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.7, 0.8], np.float32)


def reaching_skill() -> Skill:
    """One control point, drawn along a straight line to where the hand is at HOME."""
    robot = panda()
    path = np.linspace([0.2, 0.1, 0.2], np.zeros(3), 16)
    potential = NominalPotential(
        jnp.asarray(path, jnp.float32), jnp.linspace(0.3, 0.0, 16), jnp.zeros(3), jnp.float32(0.05), jnp.float32(30.0)
    )
    potential = replace(potential, end_slope=jax.grad(potential)(jnp.zeros(3)))
    factor = initial_cholesky_factor(jax.random.key(0), hidden=(8, 8), support=support_of_samples(path, 0.1, 8))
    stacked = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32)[None], (potential, factor))
    return Skill(
        learned=Learned(*stacked, jnp.full(1, 0.3), jnp.full(1, 20.0)),
        joint_damping=Damping(jnp.float32(0.01), jnp.float32(10.0), name="joint_damping"),
        joint_limit=jax.tree.map(jnp.float32, JointLimit(robot.lower, robot.upper)),
        limited=tuple(range(7)),
        offsets=jnp.zeros((1, 3)),
        targets=ControlPoints(robot, ("panda_hand",), np.zeros((1, 3), np.float32))(jnp.asarray(HOME)),
        T_world_object=jnp.eye(4),
        R_object_hand=forward_kinematics(robot, jnp.asarray(HOME), "panda_hand")[:3, :3],
        frames=("panda_hand",),
        subtasks=("hand",),
        configuration=Configuration("reach", (Subtask("hand", "panda_hand"),)),
        robot_fingerprint=robot.fingerprint,
        source="test",
    )
