"""What a page is to show: a skill in a scene or alone, or a hand-designed policy on any robot."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from .._errors import RobotError
from ..kinematics import PANDA_MODEL, Robot, forward_kinematics, load_robot, panda
from ..learning import PreparedDemonstrations, Skill
from ..scenes import Scene
from ..simulation import whole_arm_policy
from ..world import RobotSpheres, World, panda_spheres, spheres_from_model
from ._reach import reach_policy
from ._session import Content

PANDA_HAND = "panda_hand_tcp"
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
_BALLS = np.array([[0.45, 0.25, 0.45], [0.55, -0.3, 0.35]])


def reach_content(robot: str = "panda", frame: str | None = None, *, balls: int = 2, apart: bool = True) -> Content:
    """The hand-designed policy on the built-in Panda, or on the robot of an MJCF or URDF file.

    **Arguments**: `robot`, "panda" or a file; `frame`, the hand, by default the point between the Panda's fingertips,
    else the frame that the most joints move, the last of those; `balls`, how many draggable obstacles there may be;
    `apart`, whether the links keep off each other.
    **Raises** `RobotError` for a file that is none, `UnknownNameError` for a frame that is not there.
    """
    built_in = robot == "panda"
    arm = panda() if built_in else load_robot(robot)
    hand = frame or (PANDA_HAND if built_in else last_frame(arm))
    rest = READY if built_in else _middle(arm)
    spheres = panda_spheres() if built_in else _cover(robot)
    policy = reach_policy(arm, hand, rest, spheres, apart=apart)
    shown = min(balls, 1)
    return Content(
        policy=policy,
        T_world_target=np.asarray(forward_kinematics(arm, rest, hand), float),
        target="goal",
        world=World(),
        q=rest,
        hand=hand,
        spheres=spheres,
        source=None if built_in else robot,
        balls=_around(arm, rest, hand)[:balls] if not built_in else _BALLS[:balls],
        shown=shown,
    )


def skill_content(
    skill: Skill,
    robot: Robot,
    prepared: PreparedDemonstrations | None,
    *,
    scene: Scene | None = None,
    balls: int = 1,
) -> Content:
    """A skill on its robot, in a scene or alone, its object where it was demonstrated.

    **Arguments**: `prepared`, the demonstrations: the arm starts where the first of them starts; None if they cannot be
    had. `balls`, how many draggable obstacles there may be. The rest as
    `learning` and `scenes` have it.
    """
    built_in = robot.fingerprint == panda().fingerprint
    hand = PANDA_HAND if built_in else skill.frames[0]
    source = None if built_in else skill.configuration.robot
    policy = whole_arm_policy(skill, robot)
    if not built_in:
        policy = replace(policy, spheres=_cover(skill.configuration.robot))
    start = READY if built_in else _middle(robot)
    T = np.asarray(skill.T_world_object, float)
    labels = (*(f"learned: {name}" for name in skill.subtasks), "joint damping")
    labels += () if skill.joint_limit is None else ("joint limits",)
    labels += ("hand orientation",)
    labels += () if policy.itself is None else ("self-collision",)
    labels += () if policy.velocity_limit is None else ("velocity limits",)
    world = scene.obstacles(T) if scene is not None else World()
    labels += ("obstacles",) if (balls or world.size) and policy.spheres is not None else ()
    return Content(
        policy=policy,
        T_world_target=T,
        target=skill.configuration.object or "object",
        world=World(capsules=world.capsules),
        q=start if prepared is None else np.asarray(prepared.joints.q[0][0]),
        hand=hand,
        spheres=policy.spheres,
        source=source,
        furniture=scene,
        balls=_BALLS[:balls] if built_in else np.zeros((0, 3)),
        shown=0,
        frames=tuple(dict.fromkeys(skill.frames)),
        labels=labels,
    )


def last_frame(robot: Robot) -> str:
    """The frame that the most joints move; of several, the last in the file."""

    def joints_above(index: int) -> int:
        path = robot.model.path(robot.model.frames[index].body)
        return sum(robot.model.joints[j].coordinate >= 0 for b in path for j in robot.model.joints_of_body[b])

    counts = [joints_above(i) for i in range(len(robot.model.frames))]
    return robot.frame_names[max(range(len(counts)), key=lambda i: (counts[i], i))]


def model_file(robot: str) -> str:
    """The file of a robot's geometry."""
    return str(PANDA_MODEL) if robot == "panda" else robot


def _cover(source: str) -> RobotSpheres | None:
    """Spheres on the robot of a file; None where its geometry cannot be had, such as absent meshes."""
    if not Path(source).is_file():
        raise RobotError(f"{source}: there is no such file. Give the path of an MJCF or URDF file.")
    try:
        return spheres_from_model(source, max_error=0.02)
    except (RobotError, ValueError):
        return None


def _middle(robot: Robot) -> np.ndarray:
    """The middle of every joint's range, zero where there is none."""
    lower, upper = np.asarray(robot.lower, float), np.asarray(robot.upper, float)
    bounded = np.isfinite(lower) & np.isfinite(upper)
    return np.where(bounded, (np.where(bounded, lower, 0) + np.where(bounded, upper, 0)) / 2, 0.0)


def _around(robot: Robot, q: np.ndarray, hand: str) -> np.ndarray:
    """Two places beside the hand, m."""
    p = np.asarray(forward_kinematics(robot, q, hand))[:3, 3]
    return p + np.array([[0.0, 0.3, 0.0], [0.0, -0.3, 0.0]])
