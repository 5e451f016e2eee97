"""A learned skill: specification and parameters, ready to become part of any tree."""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, MissingDependencyError, RobotError, ShapeError
from .._linalg import matmul
from .._pytree import pytree, single, static
from .._rotations import nearest_rotation, pose
from .._task_map import RigidTransform, TaskMap, Translation, check_rigid, compose
from .._tree import Batched, Node, Sum, on_coordinates, pullback
from ..kinematics import ControlPoints, Robot, RobotRecord
from ..leaves import Damping, JointLimit, Learned
from ._configuration import Configuration, PolicySettings
from ._hand_flow import HandFlow
from ._hand_maps import AboutMiddle
from ._skill_on_robot import SkillOnRobot, skill_on_robot


@pytree
class Skill:
    """What was learned from a demonstration set; its arrays, all gains among them, are parameters of its tree.

    `learned`, the K subtasks' leaves as one, stacked on the leading axis, or `flow`, one policy of the whole hand, by
    the `method` it was learned by, and the other is None; `joint_damping` and `joint_limit` (of the
    joints in `limited`, None if no joint has limits); `offsets` [K, 3], the control points in their frames, m;
    `targets` [K, 3], where they go, in the object's frame, m; `T_world_object` [4, 4], the object's pose in the
    demonstrations, in the world of the robot's model; `R_object_hand` [3, 3], how the first control point's frame is
    turned where they end, in the object's frame; `frames` and `subtasks`, K names each; `configuration`, what it
    was learned with; `robot_fingerprint`, the kinematics it was learned on; `source`, where the demonstrations came
    from; `robot_record`, the robot it was learned on as plain numbers, None where a file before version 8 had none.
    """

    learned: Learned | None
    joint_damping: Damping
    joint_limit: JointLimit | None
    offsets: jax.Array
    targets: jax.Array
    T_world_object: jax.Array
    R_object_hand: jax.Array
    frames: tuple[str, ...] = static()
    subtasks: tuple[str, ...] = static()
    limited: tuple[int, ...] = static()
    configuration: Configuration = static()
    robot_fingerprint: str = static()
    source: str = static(default="unknown")
    flow: HandFlow | None = None
    robot_record: RobotRecord | None = static(default=None)

    def __post_init__(self):
        if self.robot_record is not None and self.robot_record.model.fingerprint != self.robot_fingerprint:
            raise RobotError(
                f"robot_record has kinematic fingerprint {self.robot_record.model.fingerprint}, expected that of "
                f"robot_fingerprint, {self.robot_fingerprint}."
            )
        if (self.learned is None) == (self.flow is None):
            raise ConfigurationError("a skill has either learned leaves of its subtasks or a flow.")

    @property
    def method(self) -> str:
        """How it was learned: "paper" or "flow"."""
        return "paper" if self.flow is None else "flow"

    @property
    def robot(self) -> Robot | None:
        """The robot that it was learned on, as it was then, from the skill's own file; None where that has none."""
        return None if self.robot_record is None else self.robot_record.robot()

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of what was learned apart: its subtasks, or by a flow the hand."""
        return self.subtasks if self.flow is None else ("hand",)

    @property
    def turned(self) -> bool:
        """Whether how the hand is turned on its way is part of what was learned."""
        return self.flow is not None and self.flow.turned

    @property
    def of_turn(self) -> bool:
        """Whether how the hand is turned is all that was learned; then control points are about their middle."""
        return self.flow is not None and self.flow.of_turn

    @property
    def damping_rate(self) -> float:
        """The largest damping rate of what was learned, 1/s: steps of an engine must be shorter than one over it."""
        leaf = self.learned if self.flow is None else self.flow.attractor
        return float(np.max(leaf.damping_rate)) if leaf is not None else 0.0

    def task_map(
        self, robot: Robot, T_world_object: jax.Array | None = None, targets: jax.Array | None = None
    ) -> TaskMap:
        """From joint positions [n] to the control points [K, 3] in the object's frame, each with its target at zero; of
        a turn alone, about their middle.

        **Arguments**: `robot`; `T_world_object` [4, 4], where the object is now, in the world of its model, default
        where it was demonstrated; `targets` [K, 3], in the object's frame, m, default the skill's.
        **Raises** `RobotError` if `robot` has other kinematics than the skill was learned on.

        Rana et al. 2019, section 4: `psi_k = g_k o f_k`.
        """
        self.check_robot(robot)
        points = ControlPoints(robot, self.frames, self.offsets)
        pose = self.T_world_object if T_world_object is None else T_world_object
        moved = compose(points, RigidTransform(pose), Translation(self.targets if targets is None else targets))
        return AboutMiddle(moved) if self.of_turn else moved

    def hand(self, T_world_object: jax.Array) -> tuple[str, jax.Array, jax.Array] | None:
        """What goes where with the object at `T_world_object` [4, 4]: the first control point's frame, its place in it
        [3], m, and its target [3] in the world, m. None of a turn alone, which goes nowhere."""
        if self.of_turn:
            return None
        T = jnp.asarray(T_world_object)
        return self.frames[0], self.offsets[0], matmul(T[:3, :3], jnp.asarray(self.targets[0], T.dtype)) + T[:3, 3]

    def leaf(self, robot: Robot, T_world_object: jax.Array | None = None, targets: jax.Array | None = None) -> Node:
        """The learned leaves as a node on joint space, to be added to any tree; arguments as in `task_map`."""
        if self.flow is None:
            return pullback(self.task_map(robot, T_world_object, targets), Batched(self.learned))
        self.check_robot(robot)
        pose = self.T_world_object if T_world_object is None else T_world_object
        points = None if targets is None else self.flow.targets_at(self.offsets, targets)
        return self.flow.leaf(robot, self.frames, pose, points)

    def on_joints(
        self,
        robot: Robot,
        T_world_object: jax.Array | None = None,
        joints: tuple[int, ...] | None = None,
        targets: jax.Array | None = None,
    ) -> Node:
        """What acts on the joints: damping, limits, and with a flow what leads them back to where it was learned.

        **Arguments**: `T_world_object` and `targets` as in `task_map`; `joints`, coordinates of `robot`, the arm's, by
        default all.
        """
        n = robot.num_joints
        joints = tuple(range(n)) if joints is None else joints
        node = on_coordinates(joints, n, self.joint_damping) + Sum(())
        if self.joint_limit is not None:
            node = node + on_coordinates(tuple(joints[i] for i in self.limited), n, self.joint_limit)
        if self.flow is None:
            return node
        pose = self.T_world_object if T_world_object is None else T_world_object
        points = None if targets is None else self.flow.targets_at(self.offsets, targets)
        return node + self.flow.on_joints(robot, joints, self.T_world_object, pose, points)

    def tree(self, robot: Robot, T_world_object: jax.Array | None = None, targets: jax.Array | None = None) -> Node:
        """The whole policy: learned leaves, and those of `on_joints`; arguments as in `task_map`."""
        return self.leaf(robot, T_world_object, targets) + self.on_joints(robot, T_world_object, targets=targets)

    def with_gains(self, speed: float, damping_rate: float) -> "Skill":
        """The same skill at another cruise `speed`, m/s, and `damping_rate`, 1/s: geometry stays, tempo changes.

        A skill of demonstrated tempo has the speed `flow.attractor.speed`; with twice that and twice the damping rate
        it takes half the time.
        """
        for name, value in (("speed", speed), ("damping_rate", damping_rate)):
            if not 0 < value < float("inf"):
                raise ConfigurationError(f"{name} is {value!r}, expected a positive number.")
        if self.flow is not None:
            return replace(self, flow=self.flow.with_gains(speed, damping_rate))
        gains = {"speed": jnp.full(len(self.frames), speed, jnp.float32)}
        gains["damping_rate"] = jnp.full(len(self.frames), damping_rate, jnp.float32)
        return replace(self, learned=replace(self.learned, **gains))

    def load_robot(self, file: str | None = None) -> Robot:
        """The robot that the skill was learned on, or the same one of another `file`, should its own have moved.

        It is read from the file that the configuration names, whose limits count. Where that is not at hand, or MuJoCo,
        which reads it, is not installed, it is `robot`, the skill's own.
        **Raises** `RobotError` if it cannot be read or has other kinematics, `MissingDependencyError` if it has to be
        read, for the skill is of an earlier version and has none of its own, and MuJoCo is not installed.
        """
        named = file or self.configuration.robot
        if not file and self.robot is not None and named != "panda" and not Path(named).exists():
            return self.robot
        try:
            robot = replace(self.configuration, robot=named).load_robot()
        except MissingDependencyError as error:
            if not file and self.robot is not None:
                return self.robot
            why = f"robot {named!r}" if file else f"robot {named!r}, which a skill file before version 8 does not hold,"
            raise MissingDependencyError(error.package, error.extra, why) from error
        except RobotError as error:
            if file:
                raise
            raise RobotError(
                f"the robot that the skill was learned on: {error} If it has moved: --robot FILE."
            ) from error
        self.check_robot(robot)
        return robot

    def on(self, robot: Robot, arm: Robot | None = None) -> "Skill | SkillOnRobot":
        """The skill on a `robot` that holds more than the arm that it was learned on, or itself on that arm.

        Bodies and joints are found by name. Where the arm is fixed may differ, and joints may move that were locked.

        **Arguments**: `arm`, the robot that it was learned on, by default `load_robot()`.
        **Raises** `RobotError` if `robot` has not that arm, or `arm` cannot be read.
        """
        if robot.fingerprint == self.robot_fingerprint:
            return self
        arm = arm or self.load_robot()
        self.check_robot(arm)
        return skill_on_robot(self, robot, arm)

    def check_robot(self, robot: Robot) -> None:
        """**Raises** `RobotError` if `robot` has other kinematics than the skill was learned on."""
        if robot.fingerprint != self.robot_fingerprint:
            raise RobotError(
                f"skill {self.configuration.name!r} was learned on robot {self.configuration.robot!r} with kinematic "
                f"fingerprint {self.robot_fingerprint}, but {robot.name!r} has {robot.fingerprint}. Load the robot it "
                "was learned on, or learn it again on this one. On the command line: leave --robot out, or, where the "
                "robot's file has moved, let it name that file; for `run`, give a scene with that robot."
            )


def joint_leaves(robot: Robot, policy: PolicySettings) -> tuple[Damping, JointLimit | None, tuple[int, ...]]:
    """Damping of all joints, limits of those that have them (None if no joint has), and which joints those are."""
    damping = single(Damping(**policy.joint_damping, name="joint_damping"))
    limited = list(robot.limited)
    if not limited:
        return damping, None, ()
    robot.check_ranges()
    lower, upper = np.asarray(robot.lower)[limited], np.asarray(robot.upper)[limited]
    return damping, single(JointLimit(lower, upper, **policy.joint_limit)), tuple(limited)


def rigid_targets(offsets: np.ndarray, frames: tuple[str, ...], ends: np.ndarray) -> np.ndarray:
    """Targets near the mean of several ends that one posture can meet all at once.

    Means of points on a rigid hand are no longer rigid; for the points of each frame this returns the rigid placement
    of their `offsets` nearest in least squares (Kabsch's algorithm).

    **Arguments**: `offsets` [K, 3], m, points in their `frames`; `ends` [N, K, 3], m, where N demonstrations put them.
    **Returns** [K, 3], m.
    **Raises** `ShapeError` if the shapes do not fit together.
    """
    offsets, ends = np.asarray(offsets, float), np.asarray(ends, float)
    if offsets.shape != (len(frames), 3) or ends.shape[1:] != offsets.shape:
        raise ShapeError(f"offsets {offsets.shape}, {len(frames)} frames and ends {ends.shape} do not fit together.")
    mean = ends.mean(0)
    targets = np.empty_like(mean)
    for frame in set(frames):
        rows = [k for k, name in enumerate(frames) if name == frame]
        a, b = offsets[rows], mean[rows]
        R = nearest_rotation((b - b.mean(0)).T @ (a - a.mean(0)))
        targets[rows] = (a - a.mean(0)) @ R.T + b.mean(0)
    return targets


def mean_pose(poses: np.ndarray) -> np.ndarray:
    """Mean of rigid transforms [N, 4, 4]: mean position, and the rotation nearest to the mean rotation matrix."""
    poses = check_rigid(poses)
    return pose(poses[:, :3, 3].mean(0), nearest_rotation(poses[:, :3, :3].mean(0)))
