"""A skill as the policy of a whole arm: what it was taught, and what an arm needs beside it."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._pytree import pytree, static
from .._tree import Node, pullback
from ..kinematics import PANDA_MODEL, FrameRotation, Robot, panda
from ..leaves import CollisionAvoidance, JointVelocityLimit, OrientationAttractor
from ..world import (
    ObstacleDistances,
    RobotSpheres,
    SelfDistances,
    World,
    panda_self_pairs,
    panda_spheres,
    spheres_from_model,
)


@pytree
class ScenePolicy:
    """From where the object and the obstacles are to the tree of policies.

    `skill`, with a method `tree(robot, T_world_object)`, such as `learning.Skill`; `robot`; and leaves beside it, all
    certified, each left out where it is None:

    - `spheres` on the robot, which keep off obstacles by `avoidance`;
    - `itself`, the distances of the robot to itself, kept by `self_avoidance`;
    - `velocity_limit`, of the joints;
    - `R_object_hand` [3, 3], how the frame `hand` is turned at the end, in the object's frame, and the `hand_weight`,
      `hand_stiffness`, 1/s^2, and `hand_damping`, 1/s, of the leaf that turns it there. The paper's three control
      points lie within 3 mm of one line, so that learned leaves leave the turn about it all but free; the weight is
      small enough to be felt there only.
    """

    skill: Any
    robot: Robot
    spheres: RobotSpheres | None = None
    avoidance: CollisionAvoidance = CollisionAvoidance(barrier=0.003, reach=0.05, epsilon=0.02)
    itself: SelfDistances | None = None
    self_avoidance: CollisionAvoidance = CollisionAvoidance(
        epsilon=0.1,
        barrier=0.01,
        damping_rate=2.0,
        reach=0.05,
        sigma=0.1,
        floor=0.003,
        frequency=100.0,
        name="self_collision",
    )
    velocity_limit: JointVelocityLimit | None = None
    R_object_hand: Any = None
    hand_weight: jax.Array | float = 0.003
    hand_stiffness: jax.Array | float = 25.0
    hand_damping: jax.Array | float = 10.0
    hand: str = static(default="")

    def tree(self, T_world_object: jax.Array, world: World) -> Node:
        """The policy with the object at a pose [4, 4] and these obstacles; no avoidance in a world without slots."""
        tree = self.skill.tree(self.robot, T_world_object)
        if self.R_object_hand is not None:
            goal = jnp.asarray(T_world_object)[:3, :3] @ self.R_object_hand
            turn = OrientationAttractor(
                goal, self.hand_weight, self.hand_stiffness, self.hand_damping, name="hand_orientation"
            )
            tree = tree + pullback(FrameRotation(self.robot, self.hand), turn)
        if self.itself is not None:
            tree = tree + pullback(self.itself, self.self_avoidance)
        if self.velocity_limit is not None:
            tree = tree + self.velocity_limit
        if self.spheres is None or world.size == 0:
            return tree
        distances = ObstacleDistances(self.spheres.points(self.robot), world, self.spheres.radii)
        return tree + pullback(distances, self.avoidance)


def whole_arm_policy(skill: Any, robot: Robot) -> ScenePolicy:
    """A `learning.Skill` with all leaves of `ScenePolicy` that this robot can have, in single precision.

    The hand is held as the demonstrations left it, and joints are kept below the velocity limits that the robot has.
    Spheres that keep off obstacles and off each other are known for the built-in Panda only; for another robot, pass
    your own.
    """
    spheres = itself = None
    if robot.fingerprint == panda().fingerprint:
        own = panda_spheres()
        spheres, itself = close_spheres(), SelfDistances(own.points(robot), panda_self_pairs(), own.radii)
    limit = np.asarray(robot.velocity_limit)
    policy = ScenePolicy(
        skill,
        robot,
        spheres,
        itself=itself,
        velocity_limit=JointVelocityLimit(limit, onset=0.6) if np.isfinite(limit).any() else None,
        R_object_hand=skill.R_object_hand,
        hand=skill.frames[0],
    )
    return jax.tree.map(lambda a: np.asarray(a, np.float32) if np.asarray(a).dtype == float else a, policy)


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
