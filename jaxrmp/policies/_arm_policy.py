"""The policy of a whole arm: its tasks, what an arm always needs beside them, and what it avoids."""

import warnings
from typing import Any

import jax
import numpy as np

from .._errors import NoGeometryError, ShapeError, UnsafeFileWarning
from .._pytree import pytree, single
from .._tree import Leaf, Node
from ..kinematics import Robot
from ..leaves import CollisionAvoidance, OrientationAttractor
from ..world import RobotSpheres, World, own_spheres
from ._distances import AVOIDANCE, avoidance, self_avoidance
from ._hand import HandGoal
from ._joints import NOTHING, damping, joint_limits, posture, velocity_limits


@pytree
class ArmPolicy:
    """From where the target and the obstacles are to the tree of policies; all its numbers are parameters.

    `tasks`, each with a method `tree(robot, T_world_target)`, such as a `learning.Skill` or a `HandGoal`; `always`, a
    node on joint space that depends on neither target nor obstacles; `spheres` on the `robot`, None for none, that keep
    off obstacles by the leaf `avoidance`. `dataclasses.replace` gives another policy: `always=policy.always + leaf`.
    """

    robot: Robot
    tasks: tuple[Any, ...]
    always: Node = NOTHING
    spheres: RobotSpheres | None = None
    avoidance: Leaf = AVOIDANCE

    def tree(self, T_world_target: jax.Array, world: World) -> Node:
        """The policy with the target at `T_world_target` [4, 4] and the obstacles of `world`, which may have none.

        **Raises** `ShapeError` for a target that is no [4, 4].
        """
        if np.shape(T_world_target) != (4, 4):
            raise ShapeError(f"T_world_target has shape {np.shape(T_world_target)}, expected (4, 4): a pose.")
        tasks = sum((task.tree(self.robot, T_world_target) for task in self.tasks), NOTHING)
        return tasks + self.always + avoidance(self.robot, self.spheres, world, self.avoidance)


def whole_arm_policy(skill: Any, robot: Robot, spheres: RobotSpheres | None = None) -> ArmPolicy:
    """A skill, and what an arm needs beside it: the hand's turn, no collision with itself, velocity limits, avoidance.

    All is certified, and in single precision. The hand is turned as the demonstrations left it: the paper's three
    control points lie within 3 mm of one line, so that learned leaves leave the turn about it all but free; the weight
    is small enough to be felt there only. Avoidance is felt within 5 cm, and little, not to change what was learned.

    **Arguments**: `skill`, a `learning.Skill`, or what has its `tree`, `R_object_hand` and `frames`; `spheres` that
    cover the `robot`, by default its `own_spheres`; if it has no geometry at all, an `UnsafeFileWarning` says so, and
    nothing is avoided. **Raises** as `own_spheres` if its geometry is there and cannot be had.
    """
    T = np.eye(4)
    T[:3, :3] = skill.R_object_hand
    turn = OrientationAttractor(np.eye(3), 0.003, stiffness=25.0, damping_rate=10.0, name="hand_orientation")
    tasks = skill, HandGoal(T, skill.frames[0], None, turn)
    whole = spheres or _spheres_of(robot)
    always = self_avoidance(robot, whole) + velocity_limits(robot)
    close = spheres or (whole and _spheres_of(robot, skill.frames[0]))
    leaf = CollisionAvoidance(barrier=0.003, reach=0.05, epsilon=0.02)
    return single(ArmPolicy(robot, tasks, always, close and close.moving(robot), leaf))


def reaching_policy(
    robot: Robot, hand: str, rest: Any = None, spheres: RobotSpheres | None = None, *, self_collision: bool = True
) -> ArmPolicy:
    """Takes the frame `hand` to the target's pose and holds it there, by hand-designed leaves alone, all certified.

    The gains suit an arm of about a metre and steps of 1 ms; the policy is in single precision.

    **Arguments**: `robot`; `rest`, see `posture`; `spheres`, see `whole_arm_policy`; `self_collision`, whether its
    links keep off each other. **Raises** `UnknownNameError` for a frame that is not there, and as `whole_arm_policy`.
    """
    robot.frame_index(hand)
    spheres = spheres or _spheres_of(robot)
    always = joint_limits(robot) + velocity_limits(robot) + posture(robot, rest) + damping()
    if self_collision:
        always = self_avoidance(robot, spheres) + always
    return single(ArmPolicy(robot, (HandGoal(np.eye(4), hand),), always, spheres and spheres.moving(robot)))


def _spheres_of(robot: Robot, hand: str | None = None) -> RobotSpheres | None:
    try:
        return own_spheres(robot, hand)
    except NoGeometryError as error:
        warnings.warn(f"{robot.name!r} avoids neither obstacles nor itself: {error}", UnsafeFileWarning, stacklevel=3)
        return None
