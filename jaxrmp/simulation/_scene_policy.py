"""A skill as the policy of a scene: what it was taught, the wrist held as it was shown, and obstacles avoided."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._pytree import pytree, static
from .._tree import Node, pullback
from ..kinematics import PANDA_MODEL, FrameRotation, Robot
from ..leaves import CollisionAvoidance, OrientationAttractor
from ..world import ObstacleDistances, RobotSpheres, World, panda_spheres, spheres_from_model


@pytree
class ScenePolicy:
    """From where the object and the obstacles are to the tree of policies.

    `skill`, with a method `tree(robot, T_world_object)`, such as `learning.Skill`; `robot`; `spheres` on it, which keep
    off obstacles by `avoidance`; `R_object_wrist` [3, 3], how the frame `wrist` is turned at the end, in the object's
    frame, and the `wrist_weight`, `wrist_stiffness`, 1/s^2, and `wrist_damping`, 1/s, of the leaf that turns it there
    (None: no such leaf). The paper's three control points lie within 3 mm of one line, so that learned leaves leave the
    turn about it all but free; the weight is small enough to be felt there only.
    """

    skill: Any
    robot: Robot
    spheres: RobotSpheres
    avoidance: CollisionAvoidance = CollisionAvoidance(barrier=0.003, reach=0.05, epsilon=0.02)
    R_object_wrist: Any = None
    wrist_weight: jax.Array | float = 0.003
    wrist_stiffness: jax.Array | float = 25.0
    wrist_damping: jax.Array | float = 10.0
    wrist: str = static(default="panda_hand_tcp")

    def tree(self, T_world_object: jax.Array, world: World) -> Node:
        """The policy with the object at a pose [4, 4] and these obstacles; no avoidance in a world without slots."""
        tree = self.skill.tree(self.robot, T_world_object)
        if self.R_object_wrist is not None:
            goal = jnp.asarray(T_world_object)[:3, :3] @ self.R_object_wrist
            turn = OrientationAttractor(
                goal, self.wrist_weight, self.wrist_stiffness, self.wrist_damping, name="wrist_orientation"
            )
            tree = tree + pullback(FrameRotation(self.robot, self.wrist), turn)
        if world.size == 0:
            return tree
        distances = ObstacleDistances(self.spheres.points(self.robot), world, self.spheres.radii)
        return tree + pullback(distances, self.avoidance)


@functools.cache
def close_spheres() -> RobotSpheres:
    """Spheres for the built-in Panda that stick out 8 mm at the hand, which passes close to things, else 1.4 cm.

    The hand is `panda_link7` and what it carries.
    """
    hand = ("panda_link7", "panda_hand", "panda_leftfinger", "panda_rightfinger")
    fine, coarse = spheres_from_model(PANDA_MODEL, 0.008, frames=hand), panda_spheres()
    rest = [k for k, frame in enumerate(coarse.frames) if frame not in hand]
    return RobotSpheres(
        (*fine.frames, *(coarse.frames[k] for k in rest)),
        np.concatenate([fine.offsets, np.asarray(coarse.offsets)[rest]]),
        np.concatenate([fine.radii, np.asarray(coarse.radii)[rest]]),
        coarse.coverage_error,
    )
