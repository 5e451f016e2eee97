"""What a page is to show: a skill in a scene or alone, or a hand-designed policy on any robot."""

import warnings
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from .._errors import RobotError, UnsafeFileWarning
from ..kinematics import Robot, forward_kinematics, hand_frame, load_robot, panda
from ..learning import PreparedDemonstrations, Skill
from ..policies import ArmPolicy, find_rest, reaching_policy, whole_arm_policy
from ..scenes import Scene
from ..world import RobotSpheres, World, own_spheres
from ._obstacles import SLOTS
from ._session import Content
from ._slot import RADIUS

PANDA_HAND = "panda_hand_tcp"
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
_CLEAR = 0.06  # m, from the arm to a ball at first
_BALLS = np.array([[0.45, 0.25, 0.45], [0.55, -0.3, 0.35], [0.6, 0.0, 0.75]])


def reach_content(
    robot: str | Robot = "panda",
    frame: str | None = None,
    *,
    balls: int = 1,
    slots: int | None = None,
    self_collision: bool = True,
) -> Content:
    """The hand-designed policy on the built-in Panda, or on another robot.

    Another robot starts in the middle of its joints' ranges, or where it is badly placed there, as stretched out or
    touching itself, in a posture of `policies.find_rest`.

    **Arguments**: `robot`, "panda", a file as `load_robot` takes it, or a `Robot`; `frame`, the hand, by default
    `hand_frame`'s; `balls`, how many draggable obstacles there are at first, and `slots`, how many there can be, by
    default three, none without balls; `self_collision`, whether links keep off each other.
    **Raises** `RobotError` for a file that is none, `UnknownNameError` for a frame that is not there.
    """
    built_in = robot == "panda"
    arm = robot if isinstance(robot, Robot) else panda() if built_in else load_robot(robot)
    hand = frame or hand_frame(arm)
    rest = READY if built_in else _rest_of(arm, hand)
    try:
        policy = reaching_policy(arm, hand, rest, self_collision=self_collision)
    except RobotError as error:  # meshes that are not there: the page draws a skeleton, and says that it avoids nothing
        warnings.warn(f"{arm.name!r} avoids neither obstacles nor itself: {error}", UnsafeFileWarning, stacklevel=2)
        none = RobotSpheres((), np.zeros((0, 3)), np.zeros(0))
        policy = replace(reaching_policy(arm, hand, rest, none, self_collision=False), spheres=None)
    T = np.asarray(forward_kinematics(arm, rest, hand), float)
    return Content(
        policy=policy,
        T_world_target=T,
        target="goal",
        world=World(),
        q=rest,
        hand=hand,
        balls=(_BALLS if built_in else _beside(policy, rest, T[:3, 3]))[: _slots(balls, slots)],
        shown=balls,
    )


def _rest_of(arm: Robot, hand: str) -> np.ndarray:
    with warnings.catch_warnings():  # the policy gives them
        warnings.simplefilter("ignore")
        try:
            spheres = own_spheres(arm)
            return find_rest(arm, hand, spheres, own=arm.middle)
        except RobotError:
            return find_rest(arm, hand, own=arm.middle)


def _slots(balls: int, slots: int | None) -> int:
    return max(balls, SLOTS if slots is None and balls else slots or 0)


def _beside(policy: ArmPolicy, rest: np.ndarray, hand: np.ndarray) -> np.ndarray:
    """Where balls may be, 0.3 m from the hand on either side, then elsewhere: first those clear of the arm, [6, 3]."""
    places = hand + 0.3 * np.array([[0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]])
    if policy.spheres is None or not policy.spheres.size:
        return places
    at = np.asarray(policy.spheres.points(policy.robot)(jnp.asarray(rest, jnp.float32)))
    away = np.linalg.norm(places[:, None] - at, axis=2) - np.asarray(policy.spheres.radii)
    return places[np.argsort(away.min(axis=1) < RADIUS + _CLEAR, kind="stable")]


def skill_content(
    skill: Skill,
    robot: Robot,
    prepared: PreparedDemonstrations | None,
    *,
    scene: Scene | None = None,
    balls: int = 1,
    slots: int | None = None,
) -> Content:
    """A `skill` on its `robot`, in a `scene` or alone, its object where it was demonstrated.

    **Arguments**: `prepared`, the demonstrations: the arm starts where the first of them starts; None if they cannot be
    had; `balls` and `slots` as of `reach_content`.
    """
    built_in = robot.fingerprint == panda().fingerprint
    start = READY if built_in else robot.middle
    T = np.asarray(skill.T_world_object, float)
    policy, hand = whole_arm_policy(skill, robot), PANDA_HAND if built_in else skill.frames[0]
    q = start if prepared is None else np.asarray(prepared.joints.q[0][0])
    place = np.asarray(forward_kinematics(robot, q, hand), float)[:3, 3]
    places = _BALLS if built_in else _beside(policy, q, place)
    return Content(
        policy=policy,
        T_world_target=T,
        target=skill.configuration.object or "object",
        world=World() if scene is None else scene.obstacles(T),
        q=q,
        hand=hand,
        furniture=scene,
        balls=places[: _slots(balls, slots)],
        shown=balls,
        frames=tuple(dict.fromkeys(skill.frames)),
        hints=tuple(f"learned: {name}" for name in skill.parts),
    )
