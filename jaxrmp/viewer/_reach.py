"""A whole hand-designed policy: the hand at a goal pose, obstacles, the arm itself, limits."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._pytree import pytree, single, static
from .._task_map import Selection
from .._tree import Batched, Node, pullback
from ..kinematics import ControlPoints, FrameRotation, Robot, panda
from ..leaves import (
    Attractor,
    CollisionAvoidance,
    Damping,
    JointLimit,
    JointVelocityLimit,
    OrientationAttractor,
    Posture,
)
from ..simulation import ScenePolicy
from ..world import (
    ObstacleDistances,
    RobotSpheres,
    SelfDistances,
    World,
    panda_self_pairs,
    panda_spheres,
    self_pairs,
)

_BASE = ("panda_link0", "panda_link1")  # the base, and the first link, which turns in place


@pytree
class ReachPolicy:
    """Takes the frame `hand` to a goal pose, and holds it there against what pushes it: leaves of this library alone.

    With `reach`, `turn` and `posture` it is damped inverse kinematics, run at the rate of the loop: `reach` and `turn`
    follow the goal, `posture` decides where they do not. `robot`; `spheres` on it and the `pairs` of them that must not
    meet (None and empty: no such leaf); the leaves, whose own goals count for nothing: they are set from the pose.
    """

    robot: Robot
    spheres: RobotSpheres | None
    reach: Attractor
    turn: OrientationAttractor
    avoidance: CollisionAvoidance
    self_avoidance: CollisionAvoidance
    limit: JointLimit | None
    velocity: JointVelocityLimit | None
    posture: Posture
    damping: Damping
    hand: str = static()
    limited: tuple[int, ...] = static(default=())
    paced: tuple[int, ...] = static(default=())
    pairs: tuple[tuple[int, int], ...] = static(default=())
    standing: tuple[str, ...] = static(default=())

    def tree(self, T_world_goal: jax.Array, world: World) -> Node:
        """The policy with the goal at a pose [4, 4] and these obstacles; no avoidance in a world without slots."""
        T, robot = jnp.asarray(T_world_goal), self.robot
        reach = replace(self.reach, goal=T[:3, 3])
        tree = pullback(ControlPoints(robot, self.hand), Batched(reach, shared=True))
        tree = tree + pullback(FrameRotation(robot, self.hand), replace(self.turn, R_world_goal=T[:3, :3]))
        if self.spheres is not None and world.size:
            moving = self.spheres.without(*self.standing)
            distances = ObstacleDistances(moving.points(robot), world, moving.radii)
            tree = tree + pullback(distances, self.avoidance)
        if self.spheres is not None and self.pairs:
            apart = SelfDistances(self.spheres.points(robot), self.pairs, self.spheres.radii)
            tree = tree + pullback(apart, self.self_avoidance)
        for indices, leaf in ((self.limited, self.limit), (self.paced, self.velocity)):
            if leaf is not None:
                every = indices == tuple(range(robot.num_joints))
                tree = tree + (leaf if every else pullback(Selection(indices), leaf))
        return tree + self.posture + self.damping


def reach_policy(
    robot: Robot, hand: str, rest: np.ndarray, spheres: RobotSpheres | None, *, apart: bool = True
) -> ReachPolicy:
    """The policy with gains that suit an arm of about a metre: those of the scenes benchmark.

    **Arguments**: `hand`, the frame that is taken to the goal; `rest` [n], the preferred posture; `spheres`, that cover
    the robot, or None; `apart`, whether its links keep off each other (of the built-in Panda always by its own rules).
    **Raises** `UnknownNameError` for a frame that is not there.
    """
    robot.frame_index(hand)
    lower, upper, fastest = (np.asarray(v, float) for v in (robot.lower, robot.upper, robot.velocity_limit))
    limited = tuple(np.flatnonzero(np.isfinite(lower) & np.isfinite(upper)).tolist())
    paced = tuple(np.flatnonzero(np.isfinite(fastest)).tolist())
    own = robot.fingerprint == panda().fingerprint
    pairs: Any = ()
    if spheres is not None and apart:
        pairs = panda_self_pairs() if own and spheres is panda_spheres() else self_pairs(robot, spheres.frames)
    keeping_off = ScenePolicy.self_avoidance
    policy = ReachPolicy(
        robot=robot,
        spheres=spheres,
        reach=Attractor(np.zeros(3), 5.0, 5.0, gain=10.0, sharpness=15.0, damping_rate=24.0, name="reach"),
        turn=OrientationAttractor(np.eye(3), 0.2, stiffness=50.0, damping_rate=14.0, name="turn"),
        avoidance=replace(keeping_off, reach=0.06, name="obstacles"),
        self_avoidance=keeping_off,
        limit=_joint_limit(lower, upper, limited) if limited else None,
        velocity=JointVelocityLimit(fastest[list(paced)], onset=0.6) if paced else None,
        posture=Posture(np.asarray(rest, float), weight=0.02, stiffness=0.5, damping_rate=3.0),
        damping=Damping(weight=0.02, damping_rate=1.0, name="joint_damping"),
        hand=hand,
        limited=limited,
        paced=paced,
        pairs=pairs,
        standing=tuple(name for name in _BASE if own and spheres is not None and name in spheres.frames),
    )
    return single(policy)


def _joint_limit(lower: np.ndarray, upper: np.ndarray, limited: tuple[int, ...]) -> JointLimit:
    rows = list(limited)
    return JointLimit(lower[rows], upper[rows], weight=0.05, damping_rate=5.0, barrier=0.003, reach=0.2)
