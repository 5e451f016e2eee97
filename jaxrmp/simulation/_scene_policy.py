"""A skill as the policy of a scene: what it was taught, and avoidance of what stands in the way."""

from typing import Any

import jax

from .._pytree import pytree
from .._tree import Node, pullback
from ..kinematics import Robot
from ..leaves import CollisionAvoidance
from ..world import ObstacleDistances, RobotSpheres, World


@pytree
class ScenePolicy:
    """From where the object and the obstacles are to the tree of policies.

    `skill`, with a method `tree(robot, T_world_object)`, such as `learning.Skill`; `robot`; `avoidance`, how the
    robot's `spheres` keep off obstacles.
    """

    skill: Any
    robot: Robot
    spheres: RobotSpheres
    avoidance: CollisionAvoidance

    def tree(self, T_world_object: jax.Array, world: World) -> Node:
        """The policy with the object at a pose [4, 4] and these obstacles; no avoidance in a world without slots."""
        tree = self.skill.tree(self.robot, T_world_object)
        if world.size == 0:
            return tree
        distances = ObstacleDistances(self.spheres.points(self.robot), world, self.spheres.radii)
        return tree + pullback(distances, self.avoidance)
