"""The policy of a whole arm: its tasks, what an arm always needs beside them, and what it avoids."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import numpy as np

from .._errors import ConfigurationError, NoGeometryError, ShapeError, UnsafeFileWarning
from .._pytree import pytree, single, static
from .._rotations import pose
from .._tree import Leaf, Node, on_coordinates
from ..kinematics import Robot
from ..leaves import CollisionAvoidance, OrientationAttractor
from ..world import RobotSpheres, World, own_self_pairs, own_spheres, without_never_near
from ._detour import Aside, detour
from ._distances import AVOIDANCE, avoidance, self_avoidance
from ._hand import HAND_ORIENTATION, HandGoal
from ._joints import NOTHING, damping, joint_limits, posture, velocity_limits
from ._lean_spheres import lean
from ._rest_check import check_rest

_POSE = 6  # coordinates of a pose


@pytree
class ArmPolicy:
    """From where the target and the obstacles are to the tree of policies; all its numbers are parameters.

    `tasks`, each with a method `tree(robot, T_world_target)`, such as a `learning.Skill` or a `HandGoal`; `always`, a
    node on joint space that depends on neither target nor obstacles; `spheres` on the `robot`, None for none, that keep
    off obstacles by the leaf `avoidance`. `dataclasses.replace` gives another policy: `always=policy.always + leaf`.

    Where there are several targets, `target_of` says which of them each task takes, counted from 0; empty where all
    tasks take the same one. `common`: one target may stand for all of them.
    `aside`: how hands are led round obstacles, such as one of `find_detour`; None: they are kept off alone.
    **Raises** `ConfigurationError` unless `target_of` is empty or has an entry for each task.
    """

    robot: Robot
    tasks: tuple[Any, ...]
    always: Node = NOTHING
    spheres: RobotSpheres | None = None
    avoidance: Leaf = AVOIDANCE
    target_of: tuple[int, ...] = static(default=())
    common: bool = static(default=True)
    aside: Aside | None = None

    def __post_init__(self):
        if self.target_of and len(self.target_of) != len(self.tasks):
            raise ConfigurationError(
                f"target_of is {self.target_of}, expected one entry for each of {len(self.tasks)}."
            )

    def tree(self, T_world_target: jax.Array, world: World) -> Node:
        """The policy with the target at `T_world_target` [4, 4] and the obstacles of `world`, which may have none.

        Where there are K targets, `T_world_target` is [K, 4, 4].
        **Raises** `ShapeError` for a target of another shape.
        """
        targets = self.with_targets(T_world_target)
        tasks = sum((task.tree(self.robot, T) for task, T in targets), NOTHING)
        whole = tasks + self.always + avoidance(self.robot, self.spheres, world, self.avoidance)
        if self.aside is None:
            return whole
        return sum((detour(self.robot, task, T, world, self.aside) for task, T in targets), whole)

    def leaning(self, aside: Aside | None) -> "ArmPolicy":
        """The same policy with its hands led round obstacles by `aside`; None: kept off alone."""
        return replace(self, aside=aside)

    def with_targets(self, T_world_target: jax.Array) -> list[tuple[Any, jax.Array]]:
        """Each task and its target [4, 4], of `T_world_target` as in `tree`; **raises** as that."""
        return list(zip(self.tasks, self._targets(T_world_target), strict=True))

    def _targets(self, T_world_target: jax.Array) -> list[jax.Array]:
        """The target of each task."""
        shape, count = np.shape(T_world_target), 1 + max(self.target_of, default=0)
        if shape == (4, 4) and (self.common or not self.target_of):
            return [T_world_target] * len(self.tasks)
        if shape == (count, 4, 4) and self.target_of:
            return [T_world_target[k] for k in self.target_of]
        several = f"({count}, 4, 4): a pose for each of {count}{', or (4, 4), one for all' * self.common}"
        expected = several if self.target_of else "(4, 4): a pose"
        raise ShapeError(f"T_world_target has shape {shape}, expected {expected}.")


def whole_arm_policy(skill: Any | Sequence[Any], robot: Robot, spheres: RobotSpheres | None = None) -> ArmPolicy:
    """A skill, and what an arm needs beside it: the hand's turn, no collision with itself, velocity limits, avoidance.

    All is certified, and in single precision. The hand is turned as the demonstrations left it, unless the skill turns
    it on its own, as a flow does: the paper's three control points lie within 3 mm of one line, so that learned leaves
    leave the turn about it all but free; the weight is small enough to be felt there only. Avoidance is felt within
    5 cm, and little, not to change what was learned.

    Several skills, a list of K, act at once, each with its own target, [K, 4, 4] in all, or with one for all, [4, 4]. A
    skill that was learned on one arm runs on a robot that has more (`learning.Skill.on`); joints that no skill knows,
    such as a torso's, help, are slowed down, and keep their limits.

    **Arguments**: `skill`, a `learning.Skill`, or what has its `tree`, `R_object_hand` and `frames`; `spheres` that
    cover the `robot`, by default its `own_spheres`; if it has no geometry at all, an `UnsafeFileWarning` says so, and
    nothing is avoided. **Raises** as `own_spheres` if its geometry is there and cannot be had, as `learning.Skill.on`
    for a robot that does not have a skill's arm, `ConfigurationError` for no skill.
    """
    several = isinstance(skill, list | tuple)
    given: tuple[Any, ...] = tuple(skill) if several else (skill,)
    if not given:
        raise ConfigurationError("skill is empty, expected a skill, or one for each arm.")
    skills = [each.on(robot) if hasattr(each, "on") else each for each in given]
    of = [[each] if getattr(each, "turned", False) else [each, _turn(each)] for each in skills]
    tasks = tuple(task for each in of for task in each)
    target_of = tuple(k for k, each in enumerate(of) for _ in each) if several else ()
    whole = spheres or _spheres_of(robot)
    always = self_avoidance(robot, whole) + velocity_limits(robot) + _of_others(robot, skills)
    close = spheres or (whole and _spheres_of(robot, [each.frames[0] for each in skills]))
    leaf = CollisionAvoidance(0.02, 0.003, 0.0, 0.05, 0.5, frequency=np.inf)
    return single(ArmPolicy(robot, tasks, always, close and close.moving(robot), leaf, target_of))


def _turn(skill: Any) -> HandGoal:
    """The hand turned as a skill's demonstrations left it."""
    turn = OrientationAttractor(np.eye(3), 0.003, stiffness=25.0, damping_rate=10.0, name="hand_orientation")
    return HandGoal(pose(np.zeros(3), np.asarray(skill.R_object_hand)), skill.frames[0], None, turn)


def _of_others(robot: Robot, skills: Sequence[Any]) -> Node:
    """Limits and damping of the joints that no skill knows."""
    n = robot.num_joints
    known = {joint for skill in skills for joint in getattr(skill, "joints", range(n))}
    rows = tuple(joint for joint in range(n) if joint not in known)
    if not rows:
        return NOTHING
    other = np.isin(np.arange(n), rows)
    lower, upper = np.where(other, robot.lower, -np.inf), np.where(other, robot.upper, np.inf)
    return joint_limits(replace(robot, lower=lower, upper=upper)) + on_coordinates(rows, n, damping())


def reaching_policy(
    robot: Robot,
    hand: str | Sequence[str],
    rest: Any = None,
    spheres: RobotSpheres | None = None,
    *,
    self_collision: bool = True,
) -> ArmPolicy:
    """Takes the frame `hand` to the target's pose and holds it there, by hand-designed leaves alone, all certified.

    With several hands, H names, each has its own target, [H, 4, 4] in all, and all are taken there at once: joints that
    move more than one, such as a torso's, settle where the hands' pulls are in balance.
    A hand that fewer than six joints move cannot have every pose: its turn has a tenth of the weight then, so that it
    gets to the target's position to a millimetre or two, and turns as far as the joints allow. The gains suit an arm of
    about a metre and steps of 1 ms; the policy is in single precision.

    **Arguments**: `robot`; `rest`, see `posture`; `spheres`, see `whole_arm_policy`; `self_collision`, whether its
    links keep off each other. **Raises** `UnknownNameError` for a frame that is not there, `ConfigurationError` for no
    hand or one that is named twice, or a `rest` that is not finite, beyond the joints' limits, or one in which links
    touch each other (of the default, a warning says it), and as `whole_arm_policy`.
    """
    several = not isinstance(hand, str)
    hands = tuple(hand) if several else (hand,)
    if not hands or len(set(hands)) < len(hands):
        raise ConfigurationError(f"hand is {hand!r}, expected at least one frame, and each once.")
    tasks = tuple(_reaching(robot, name) for name in hands)
    spheres = spheres or _spheres_of(robot)
    always = joint_limits(robot) + velocity_limits(robot) + posture(robot, rest) + damping()
    moving = None
    if spheres and spheres.size:
        pairs = own_self_pairs(robot, spheres) if self_collision else ()
        check_rest(robot, spheres, pairs, rest)
        pairs = without_never_near(robot, spheres, pairs)
        moving, own, pairs = lean(robot, spheres, pairs)
        always = self_avoidance(robot, own, pairs) + always if pairs else always
    target_of = tuple(range(len(hands))) if several else ()
    return single(ArmPolicy(robot, tasks, always, moving, target_of=target_of, common=False))


def _reaching(robot: Robot, hand: str) -> HandGoal:
    """A hand at the target, turned so as far as its joints allow."""
    joints = robot.model.joints_above(robot.model.frames[robot.frame_index(hand)].body)
    posed = len({robot.model.joints[i].coordinate for i in joints}) >= _POSE
    turn = HAND_ORIENTATION if posed else replace(HAND_ORIENTATION, weight=0.1 * HAND_ORIENTATION.weight)
    return HandGoal(np.eye(4), hand, orientation=turn)


def _spheres_of(robot: Robot, hands: Sequence[str] = ()) -> RobotSpheres | None:
    try:
        return own_spheres(robot, hands)
    except NoGeometryError as error:
        warnings.warn(f"{robot.name!r} avoids neither obstacles nor itself: {error}", UnsafeFileWarning, stacklevel=3)
        return None
