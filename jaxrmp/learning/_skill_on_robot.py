"""A skill on a robot that holds more than the arm that it was learned on, such as a second arm or a torso."""

import warnings
from dataclasses import replace
from typing import TYPE_CHECKING

import jax
import numpy as np

from .._errors import FileWarning, RobotError
from .._linalg import einsum, matmul
from .._pytree import pytree, static
from .._tree import Node
from ..kinematics import Robot, arm_differences, forward_kinematics

if TYPE_CHECKING:
    from ._hand_flow import HandFlow
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
    def turned(self) -> bool:
        """See `Skill.turned`."""
        return self.skill.turned

    @property
    def R_object_hand(self) -> jax.Array:
        """How the first of `frames` is turned where the demonstrations end, in the object's frame, [3, 3]."""
        return self.skill.R_object_hand

    def hand(self, T_world_object: jax.Array) -> tuple[str, jax.Array, jax.Array] | None:
        """As `Skill.hand`, with the object at `T_world_object` [4, 4]."""
        return self.skill.hand(T_world_object)

    def tree(self, robot: Robot, T_world_object: jax.Array | None = None, targets: jax.Array | None = None) -> Node:
        """As `Skill.tree`, on the joints of the larger `robot`.

        **Arguments**: `T_world_object` [4, 4], where the object is in that robot's world, default where it was
        demonstrated; `targets` [K, 3], see `Skill.task_map`.
        """
        leaf = self.skill.leaf(robot, T_world_object, targets)
        return leaf + self.skill.on_joints(robot, T_world_object, self.joints, targets)


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
    if skill.flow is not None:
        points["flow"] = _flow_on(skill, frames[0], R, np.array([frame.position for frame in at]), robot, arm)
    moved = replace(skill, frames=frames, robot_fingerprint=robot.fingerprint, robot_record=None, **points)
    return SkillOnRobot(moved, tuple(robot.joint_index(name) for name in arm.joint_names))


def _flow_on(skill: "Skill", body: str, R: np.ndarray, at: np.ndarray, robot: Robot, arm: Robot) -> "HandFlow":
    """A skill's flow with its points in the frames of bodies, turned by `R` and at `at`. Its funnel and posture hold
    where the arm stands as it stood; elsewhere they are left out, and it is said."""
    flow = skill.flow
    assert flow is not None
    R, at = (R[:1].repeat(len(flow.offsets), 0), at[:1]) if flow.turned else (R, at)
    offsets = (einsum("kij,kj->ki", R, flow.offsets) + at).astype(np.float32)
    q = np.zeros(robot.num_joints)
    rows = [robot.joint_index(name) for name in arm.joint_names]
    q[rows] = arm.middle
    there, here = (forward_kinematics(*found, body) for found in ((arm, arm.middle), (robot, q)))
    of_robot, of_arm = (len(r.model.joints_above(r.model.frames[r.frame_index(body)].body)) for r in (robot, arm))
    if of_robot == of_arm and np.allclose(there, here, atol=1e-5):
        return replace(flow, offsets=offsets)
    warnings.warn(
        f"skill {skill.configuration.name!r}: {robot.name!r} has its arm elsewhere, or moves it as a whole. The funnel "
        "that leads joints back to where the skill was learned is left out: from far away it may not arrive.",
        FileWarning,
        stacklevel=4,
    )
    return replace(flow, offsets=offsets, funnel=None, posture=None)
