"""A skill on a robot that holds more than the arm that it was learned on, such as a second arm or a torso."""

from dataclasses import replace
from typing import TYPE_CHECKING

import jax
import numpy as np

from .._errors import RobotError
from .._linalg import einsum, matmul
from .._pytree import pytree, static
from .._tree import Node, on_coordinates
from ..kinematics import Robot, arm_differences

if TYPE_CHECKING:
    from ._skill import Skill


@pytree
class SkillOnRobot:
    """A `Skill` on the arm of a larger robot: its control points are moved by all joints, torso and lift too.

    Its damping and limits act on the arm's own joints. `skill`, its control points in the frames of bodies, which all
    robots of a file share; `joints`, the larger robot's coordinates of the arm's joints. Made by `Skill.on`.
    """

    skill: "Skill"
    joints: tuple[int, ...] = static()

    @property
    def frames(self) -> tuple[str, ...]:
        """The frame of each control point."""
        return self.skill.frames

    @property
    def R_object_hand(self) -> jax.Array:
        """How the first of `frames` is turned where the demonstrations end, in the object's frame, [3, 3]."""
        return self.skill.R_object_hand

    def tree(self, robot: Robot, T_world_object: jax.Array | None = None, targets: jax.Array | None = None) -> Node:
        """As `Skill.tree`, on the joints of the larger `robot`.

        **Arguments**: `T_world_object` [4, 4], where the object is in that robot's world, default where it was
        demonstrated; `targets` [K, 3], see `Skill.task_map`.
        """
        n, limited = robot.num_joints, tuple(self.joints[i] for i in self.skill.limited)
        leaf = self.skill.leaf(robot, T_world_object, targets)
        tree = leaf + on_coordinates(self.joints, n, self.skill.joint_damping)
        return tree if self.skill.joint_limit is None else tree + on_coordinates(limited, n, self.skill.joint_limit)


def skill_on_robot(skill: "Skill", robot: Robot, arm: Robot) -> SkillOnRobot:
    """The `skill`, learned on `arm`, on a `robot` that has the same arm by the names of bodies and joints.

    **Raises** `RobotError` if it has not, saying which skill and what is missing or different.
    """
    different = [why for frame in dict.fromkeys(skill.frames) for why in arm_differences(arm, robot, frame)]
    missing = [name for name in arm.joint_names if name not in robot.joint_names]
    if missing:
        different.insert(0, f"{missing} are no joints that move on their own there")
    if different:
        raise RobotError(
            f"skill {skill.configuration.name!r} cannot run on {robot.name!r}, which has not the arm of "
            f"{skill.configuration.robot!r} that it was learned on: {'; '.join(dict.fromkeys(different))}. Load a "
            "robot of the same file, with these joints free, or learn the skill on this one."
        )
    at = [arm.model.frames[arm.frame_index(name)] for name in skill.frames]
    R = np.array([frame.rotation for frame in at]).reshape(-1, 3, 3)
    offsets = einsum("kij,kj->ki", R, skill.offsets) + np.array([frame.position for frame in at])
    points = {"offsets": offsets.astype(skill.offsets.dtype), "R_object_hand": matmul(skill.R_object_hand, R[0].T)}
    frames = tuple(arm.model.bodies[frame.body].name for frame in at)
    moved = replace(skill, frames=frames, robot_fingerprint=robot.fingerprint, **points)
    return SkillOnRobot(moved, tuple(robot.joint_index(name) for name in arm.joint_names))
