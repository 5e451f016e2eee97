"""A scene: a MuJoCo model of an arm with what it works on, and the rules of the task there."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from .._errors import ConfigurationError, RobotError, UnknownNameError
from .._rotations import pose, quaternion_of_rotation, rotation_angle, rotation_of_quaternion
from .._task_map import check_rigid
from ..kinematics import Robot
from ..kinematics._mujoco import import_mujoco
from ..world import World
from ._gripper import Gripper, Width

START_SPREAD = 0.15
"""Of every joint around a demonstrated start, rad."""
_FAR = 1.0  # distances beyond this are not looked at, m


class Left(NamedTuple):
    """What is left to a scene's goal.

    `there`, whether that counts as reached; `words` for it, such as "open by 3.1 mm"; `error`, m; `angle`, rad, NaN
    where none is judged.
    """

    there: bool
    words: str
    error: float
    angle: float = float("nan")


class Plotted(NamedTuple):
    """What is drawn over time: the position of the scene's `joint` times `scale`, named `label`, and a line at
    `goal`."""

    label: str
    scale: float = 1.0
    goal: float | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """A MuJoCo model of an arm with what it works on; one model serves many `mujoco.MjData` and many poses of the
    object.

    `name`; `spec`, the `mujoco.MjSpec` of everything, which is compiled for steps of a millisecond; `robot`, the arm in
    it, whose joints have a motor each; `hand`, the site or body of the arm that the task is about; `object`, the body
    whose frame skills speak of, a mocap body or one with a free joint, empty without one; `T_world_object` [4, 4],
    where it is at first; `may_touch`, the geometries that the arm may touch, besides which it must touch nothing;
    `standing`, bodies of the arm that stand on something; `joint`, the one that the task moves, if any, and `start`,
    where it is at first (m, rad); `plotted`, how it is drawn; `tracked`, the object that a skill must have been taught
    with, empty for the frame of the arm's base; `gripper`, what moves the fingers, None where they are held.

    What success is: `goal`, in a word or two, is reached while `left` says so and the hand is slower than `speed`, m/s.
    Here: the hand within `position`, m, and `angle`, rad, of `T_object_hand` [4, 4], where the demonstrations left it
    in the object's frame. `per_round`: a variation is drawn for a round of demonstrated starts, not for each trial.
    `model`, a `mujoco.MjModel`, is compiled from `spec` unless given. A scene of its own kind derives from this class
    and says in `left` and `vary` what holds there.

    **Raises** `RobotError` for an arm that is not in the model or cannot be driven, `UnknownNameError` for a name that
    is not there, `ConfigurationError` for an object that cannot be placed.
    """

    name: str
    spec: Any
    robot: Robot
    hand: str = ""
    object: str = "object"
    T_world_object: np.ndarray = field(default_factory=lambda: np.eye(4))
    may_touch: tuple[str, ...] = ()
    standing: tuple[str, ...] = ()
    joint: str = ""
    start: float = 0.0
    plotted: Plotted | None = None
    tracked: str = ""
    goal: str = "at the goal"
    position: float = 0.01
    angle: float = float(np.radians(10.0))
    speed: float = float("inf")
    per_round: bool = False
    T_object_hand: np.ndarray | None = None
    gripper: Gripper | None = None
    model: Any = None

    def __post_init__(self):
        if self.model is not None:
            return
        option, visual, mujoco = self.spec.option, self.spec.visual.global_, import_mujoco()
        option.timestep, option.integrator = 0.001, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a diverged state shall be seen
        visual.offwidth, visual.offheight = 1280, 960
        try:
            object.__setattr__(self, "model", self.spec.compile())
        except ValueError as error:
            raise RobotError(f"scene {self.name!r}: MuJoCo cannot compile its model: {error}") from error
        self._check()

    @property
    def judges(self) -> bool:
        """Whether `left` has a goal to judge by."""
        return self.T_object_hand is not None or type(self).left is not Scene.left

    def left(self, data: Any) -> Left:
        """What is left to the goal in `data`, a state of the model: a `mujoco.MjData`."""
        if self.T_object_hand is None:
            raise ConfigurationError(
                f"scene {self.name!r} needs T_object_hand, the hand's pose in the object's frame that counts as there: "
                "dataclasses.replace(scene, T_object_hand=...), of learning.demonstrated_end."
            )
        wanted, T = self.object_pose(data) @ self.T_object_hand, self.hand_pose(data)
        error = float(np.linalg.norm(T[:3, 3] - wanted[:3, 3]))
        angle = float(rotation_angle(wanted[:3, :3].T @ T[:3, :3]))
        words = f"{100 * error:.1f} cm and {np.degrees(angle):.0f} degrees off"
        return Left(error <= self.position and angle <= self.angle, words, error, angle)

    def vary(self, trial: Any, rng: np.random.Generator, shown: Sequence[tuple[np.ndarray, np.ndarray]]) -> Any:
        """A `simulation.Trial` like `trial`, varied; None if this draw will not do.

        Here: every joint of the start by up to `START_SPREAD`. **Arguments**: `rng`, of all chance; `shown`, the
        demonstrations, each as its path [T, n], rad, and the object's pose [4, 4].
        """
        q = trial.q + rng.uniform(-START_SPREAD, START_SPREAD, len(trial.q))
        return trial._replace(q=np.clip(q, np.asarray(self.robot.lower), np.asarray(self.robot.upper)))

    def obstacles(self, T_world_object: np.ndarray | None = None) -> World:
        """What the policy is told to avoid with the object at `T_world_object`, default at first. Here: nothing."""
        return World()

    def moving_obstacles(self, data: Any, time: float) -> World | None:
        """What the policy is told to avoid `time` seconds after the start of a trial, for obstacles that move by
        themselves: this moves them in `data`, from MuJoCo's next step on, and tells where they are now, in a world of
        as many slots as `obstacles`. Here, None: they stand still, as they do for `evaluate`.
        """
        return None

    def at(self, trial: Any) -> "Scene":
        """The scene as it is in `trial`, a `simulation.Trial`; the model is shared."""
        return replace(self, **{**dict(trial.changes), "T_world_object": check_rigid(trial.T_world_object)})

    def with_object(self, T_world_object: np.ndarray) -> "Scene":
        """The same scene with the object at `T_world_object` [4, 4] at first; the model is shared."""
        return replace(self, T_world_object=check_rigid(T_world_object))

    def fresh(self) -> Any:
        """A `mujoco.MjData` with everything but the arm where it is at first."""
        data = import_mujoco().MjData(self.model)
        self.place(data, self.T_world_object)
        if self.joint:
            data.joint(self.joint).qpos[0] = self.start
        if self.gripper is not None:
            self.move_gripper(data, "open")
        self.moving_obstacles(data, 0.0)
        return data

    def data(self, q: np.ndarray) -> Any:
        """A `mujoco.MjData` with the arm at rest at `q` [n], everything else where it is at first, forward computed.

        **Raises** `ConfigurationError` if `q` is not [n], or in collision with what must not be touched or with the
        arm itself.
        """
        q = np.asarray(q, float)
        if q.shape != (self.robot.num_joints,) or not np.isfinite(q).all():
            raise ConfigurationError(f"q is {q.tolist()}, expected {self.robot.num_joints} finite joint positions.")
        data = self.fresh()
        data.qpos[self.arm_qpos] = q
        import_mujoco().mj_forward(self.model, data)
        if touched := self.contacts(data):
            raise ConfigurationError(
                f"the start {np.round(q, 3).tolist()} is in collision: {', '.join(touched)}. Start elsewhere, or move "
                "the object."
            )
        return data

    def move_gripper(self, data: Any, width: Width) -> None:
        """Tell the fingers in `data` to be "open", "close" or `width` apart, m, from MuJoCo's next step on.

        **Raises** `ConfigurationError` for a width that they do not have, or where the scene holds them.
        """
        if self.gripper is None:
            raise ConfigurationError(f"scene {self.name!r} holds the fingers: it has no scenes.Gripper.")
        for name in self.gripper.actuators:
            data.actuator(name).ctrl = self.gripper.control(width)

    def place(self, data: Any, T_world_object: np.ndarray) -> None:
        """Put the object, and all with it, at `T_world_object` [4, 4] in `data`, from MuJoCo's next step on.

        **Raises** `RigidTransformError`.
        """
        self.move_object(data, check_rigid(T_world_object))

    def move_object(self, data: Any, T_world_object: np.ndarray) -> None:
        """Move the object alone, in `data`, to `T_world_object` [4, 4], which is not checked."""
        if self.object:
            position, wxyz = self._object_state(data)
            position[:], wxyz[:] = T_world_object[:3, 3], quaternion_of_rotation(T_world_object[:3, :3])

    def object_pose(self, data: Any) -> np.ndarray:
        """`T_world_object` [4, 4] in `data`, the frame that skills speak of."""
        if not self.object:
            return np.array(self.T_world_object, float)
        position, wxyz = self._object_state(data)
        return pose(position, rotation_of_quaternion(wxyz))

    def hand_pose(self, data: Any) -> np.ndarray:
        """`T_world_hand` [4, 4] in `data`."""
        hand = data.site(self.hand) if self._hand_is_site else data.body(self.hand)
        return pose(hand.xpos, hand.xmat.reshape(3, 3))

    def joint_position(self, data: Any) -> float:
        """Where the task's joint is in `data`, m or rad."""
        return float(data.joint(self.joint).qpos[0])

    def contacts(self, data: Any) -> list[str]:
        """What the arm touches in `data` and must not, itself too, as "geometry of the arm's body - other geometry"."""
        m, found = self.model, set()
        for a, b in data.contact.geom[data.contact.dist < 0].tolist():
            a, b = (a, b) if self.of_arm[a] else (b, a)
            if self.of_arm[a] and (b in self._forbidden or self.of_arm[b]):
                other = m.geom(b).name or m.body(int(m.geom_bodyid[b])).name
                found.add(f"{m.body(int(m.geom_bodyid[a])).name} - {other}")
        return sorted(found)

    def touches(self, path: np.ndarray) -> bool:
        """Whether the arm touches what it must not anywhere on a `path` [T, n], everything else as at first."""
        mujoco, data = import_mujoco(), self.fresh()
        for q in path:
            data.qpos[self.arm_qpos] = q
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_collision(self.model, data)
            if self.contacts(data):
                return True
        return False

    def clearance(self, data: Any) -> float:
        """Least distance in `data` of the arm's geometry to what it must not touch, planes aside, m; at most 1, and
        infinite where there is nothing of that kind: then nothing is checked."""
        mujoco = import_mujoco()
        if not self.keeps_off:
            return float("inf")
        m, least = self.model, _FAR
        x, reach = data.geom_xpos, m.geom_rbound
        for b in self.forbidden:
            if m.geom_type[b] == mujoco.mjtGeom.mjGEOM_PLANE:
                continue
            near = np.linalg.norm(x[self.arm_geoms] - x[b], axis=1) - reach[self.arm_geoms] - reach[b]
            for a in self.arm_geoms[near < least]:
                least = min(least, mujoco.mj_geomDistance(m, data, int(a), int(b), least, None))
        return float(least)

    def check_object(self, name: str, skill: str = "") -> None:
        """**Raises** `ConfigurationError` unless `name`, the object of a `skill`, empty for none, is tracked here."""
        if (name or "") == self.tracked:
            return
        raise ConfigurationError(
            f"skill {skill!r} needs object {name!r}, which scene {self.name!r} does not have: use one that tracks it."
            if name
            else f"scene {self.name!r} tracks the object {self.tracked!r}, and skill {skill!r} lives in the frame of "
            "the arm's base: use --scene drawer, or another that tracks none."
        )

    @cached_property
    def arm_qpos(self) -> np.ndarray:
        """Where the n joints are in `qpos`."""
        return np.array([self.model.joint(name).qposadr[0] for name in self.robot.joint_names])

    @cached_property
    def arm_dofs(self) -> np.ndarray:
        """Where the n joints are in `qvel`."""
        return np.array([self.model.joint(name).dofadr[0] for name in self.robot.joint_names])

    @cached_property
    def arm_actuators(self) -> np.ndarray:
        """Where the motors of the n joints are in `ctrl`."""
        joints = [self.model.joint(name).id for name in self.robot.joint_names]
        motors = self.model.actuator_trnid[:, 0].tolist()
        return np.array([motors.index(joint) for joint in joints])

    @cached_property
    def gear(self) -> np.ndarray:
        """Torque of each motor for a control of one, N m or N, [n]."""
        m, motors = self.model, self.arm_actuators
        return np.array(m.actuator_gear[motors, 0] * m.actuator_gainprm[motors, 0])

    @cached_property
    def torque_limit(self) -> np.ndarray:
        """The largest torque of each motor, N m or N, [n]; infinite where there is none."""
        m, motors = self.model, self.arm_actuators
        most = np.where(m.actuator_ctrllimited[motors], m.actuator_ctrlrange[motors, 1], np.inf)
        return most * np.abs(self.gear)

    @cached_property
    def of_arm(self) -> np.ndarray:
        """Which geometries are the arm's, [ngeom]."""
        names = {body.name for body in self.robot.model.bodies[1:]}
        bodies = np.array([self.model.body(b).name in names for b in range(self.model.nbody)])
        return bodies[self.model.geom_bodyid]

    @cached_property
    def arm_geoms(self) -> np.ndarray:
        """The arm's geometries."""
        return np.flatnonzero(self.of_arm)

    @cached_property
    def forbidden(self) -> np.ndarray:
        """The geometries that the arm can touch and must not."""
        types, meets = self.model.geom_contype, self.model.geom_conaffinity
        arm = self.arm_geoms
        can = ((types[arm] & meets[:, None]) | (types[:, None] & meets[arm])).any(1) & ~self.of_arm
        return np.array([g for g in np.flatnonzero(can) if self.model.geom(int(g)).name not in self.may_touch], int)

    @cached_property
    def keeps_off(self) -> bool:
        """Whether there is anything, planes aside, that the arm must not touch."""
        plane = import_mujoco().mjtGeom.mjGEOM_PLANE
        return len(self.arm_geoms) > 0 and bool((self.model.geom_type[self.forbidden] != plane).any())

    @cached_property
    def _forbidden(self) -> set[int]:
        return set(self.forbidden.tolist())

    @cached_property
    def _hand_is_site(self) -> bool:
        return any(self.model.site(i).name == self.hand for i in range(self.model.nsite))

    def _object_state(self, data: Any) -> tuple[np.ndarray, np.ndarray]:
        """Position [3] and quaternion [4] of the object in a state, to be read or written."""
        body = self.model.body(self.object)
        if body.mocapid[0] >= 0:
            return data.mocap_pos[body.mocapid[0]], data.mocap_quat[body.mocapid[0]]
        first = self.model.jnt_qposadr[body.jntadr[0]]
        return data.qpos[first : first + 3], data.qpos[first + 3 : first + 7]

    def _check(self) -> None:
        mujoco, m = import_mujoco(), self.model
        there = [m.joint(j).name for j in range(m.njnt)]
        for name in (*self.robot.joint_names, *([self.joint] if self.joint else ())):
            UnknownNameError.check(f"joint of scene {self.name!r}", name, there)
        gripped = self.gripper.joints if self.gripper else ()
        for name in self.gripper.actuators if self.gripper else ():
            UnknownNameError.check(f"actuator of scene {self.name!r}", name, [m.actuator(a).name for a in range(m.nu)])
        for name in gripped:
            UnknownNameError.check(f"finger's joint of scene {self.name!r}", name, there)
        for joint in self.robot.model.joints:
            if joint.coordinate < 0 and joint.name in there and joint.name not in gripped:
                raise RobotError(
                    f"scene {self.name!r}: joint {joint.name!r} is locked in the robot and moves in the model. "
                    "Delete it there, its body where it shall stay."
                )
        for name in self.robot.joint_names:
            motors = [a for a in range(m.nu) if m.actuator_trnid[a, 0] == m.joint(name).id]
            plain = (m.actuator_trntype, m.actuator_dyntype, m.actuator_gaintype, m.actuator_biastype)
            if len(motors) != 1 or any(kind[motors[0]] for kind in plain):  # all of them 0: a plain motor of a joint
                raise RobotError(
                    f"scene {self.name!r}: joint {name!r} has no motor of its own, which physics needs to drive it: "
                    f'<actuator><motor joint="{name}" ctrlrange="-50 50"/></actuator>, its range in N m.'
                )
        bodies = [m.body(b).name for b in range(m.nbody)]
        if self.hand and not self._hand_is_site and self.hand not in bodies:
            raise UnknownNameError(f"hand of scene {self.name!r}", self.hand, self.robot.frame_names)
        geoms = [m.geom(g).name for g in range(m.ngeom) if m.geom(g).name]
        for name in self.may_touch:
            UnknownNameError.check(f"geometry of scene {self.name!r}", name, geoms)
        if not self.object:
            return
        UnknownNameError.check(f"object of scene {self.name!r}", self.object, bodies)
        body = m.body(self.object)
        free = body.jntnum[0] == 1 and m.jnt_type[body.jntadr[0]] == mujoco.mjtJoint.mjJNT_FREE
        if body.mocapid[0] < 0 and not free:
            raise ConfigurationError(
                f"scene {self.name!r}: the object {self.object!r} cannot be placed. Make it a mocap body "
                '(mocap="true"), with all that stands with it below it, or give it a free joint.'
            )
        check_rigid(self.T_world_object)
