"""States that reach a pose, or run a skill."""

from dataclasses import replace
from typing import Any

import numpy as np

from .._errors import ConfigurationError
from .._pytree import single
from .._rotations import pose
from .._task_map import check_rigid
from ..kinematics import Robot
from ..learning import Skill
from ..policies import HandGoal, reaching_policy, whole_arm_policy
from ..world import RobotSpheres
from ._sequence import After, Aim, Arrived, State


def reach(
    name: str,
    robot: Robot,
    frame: str,
    T_goal: Any,
    guard: Arrived | After = Arrived(),  # noqa: B008
    *,
    turned: bool = True,
    rest: Any = None,
    spheres: RobotSpheres | None = None,
    **settings: Any,
) -> State:
    """A state called `name` that takes a `frame` of the `robot` to `T_goal` [4, 4], by `policies.reaching_policy`.

    **Arguments**: `guard`, when it is over; `turned`, whether the turn counts too, or is free; `rest` and `spheres`, as
    there; `settings` of the `State`, such as `relative_to="world"` (by default the object) or `gripper`.
    **Raises** as `reaching_policy` and `State`; `RigidTransformError` for a goal that is no pose.
    """
    policy = reaching_policy(robot, frame, rest, spheres)
    if not turned:
        tasks = [replace(task, orientation=None) for task in policy.tasks if isinstance(task, HandGoal)]
        policy = replace(policy, tasks=tuple(tasks))
    aim = single(Aim(np.zeros(3), np.eye(4), frame, turned))
    return State(name, policy, guard, aim, T_target=np.array(check_rigid(T_goal), float), **settings)


def perform(
    name: str,
    skill: Skill,
    robot: Robot,
    guard: Arrived | After = Arrived(),  # noqa: B008
    *,
    T_world_object: Any = None,
    **settings: Any,
) -> State:
    """A state called `name` that runs a `skill` on the `robot`, by `policies.whole_arm_policy`.

    It has arrived with the first of the skill's control points at its target, turned as the demonstrations left it.

    **Arguments**: `guard` and `settings` as in `reach`; `T_world_object` [4, 4], where the scene's object is at first,
    for a skill that was taught with no object, whose own frame then moves with the scene's object; None where the
    skill's object is the scene's.
    **Raises** `RobotError` for another robot than the skill's, `ConfigurationError` for a skill of a turn alone.
    """
    skill.check_robot(robot)
    if skill.of_turn:
        raise ConfigurationError(f"state {name!r}: the skill was learned of a turn alone, and arrives at no place.")
    T = np.eye(4)
    if T_world_object is not None:
        T = np.linalg.inv(np.asarray(T_world_object, float)) @ np.asarray(skill.T_world_object, float)
    end = pose(np.asarray(skill.targets[0], float), np.asarray(skill.R_object_hand, float))
    aim = single(Aim(np.asarray(skill.offsets[0]), end, skill.frames[0]))
    return State(name, whole_arm_policy(skill, robot), guard, aim, T_target=check_rigid(T), **settings)
