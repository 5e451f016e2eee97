"""Scenes: a MuJoCo model of the arm with furniture, and what a runner asks about it."""

import os
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from .._errors import ConfigurationError, UnknownNameError
from .._rotations import pose, quaternion_of_rotation, rotation_of_quaternion, rotation_of_vector
from .._task_map import check_rigid
from ..kinematics import Robot, panda
from ..kinematics._mujoco import import_mujoco
from ..world import Capsules, World
from ._door import DOOR_JOINT, add_door
from ._drawer import DRAWER_JOINT, OPENING, add_drawer
from ._meshes import add_meshes, panda_meshes
from ._parts import add_camera, add_object, arm_spec

SCENES = ("drawer", "drawer_obstacle", "door")
"""Names of the scenes."""

_DRAWER_POSE = np.array([0.641, -0.436, 0.236])  # where the recorded demonstrations end on average, in the base, m
_DOOR_POSE = np.array([0.017, -0.430, 0.762])
_DOOR_YAW = np.radians(-127.5)
_FAR = 1.0  # distances beyond this are not looked at, m


class Cylinder(NamedTuple):
    """A standing cylinder: `center` of its foot in the object's frame, `radius` and `height`, all in m.

    Its foot is on the floor whatever the height of the object. What the arm touches is a capsule of the same radius
    and height, since MJX has no contact between boxes and cylinders.
    """

    center: tuple[float, float] = (-0.18, 0.215)
    radius: float = 0.025
    height: float = 0.30


@dataclass(frozen=True)
class Scene:
    """A MuJoCo model of the arm with furniture; one model serves many `mujoco.MjData`, each with its object's pose.

    `name`; `model`, a `mujoco.MjModel`; `robot`, the arm inside it, its fingers held; `arm_qpos`, `arm_dofs`,
    `arm_actuators`, where its n joints are in `qpos`, `qvel`, `ctrl`; `arm_geoms`, its geometries; `forbidden`, those
    that it must not touch; `T_world_object` [4, 4], where the object stands at first; `cylinder`, None without one;
    `joint`, the furniture's joint, and `start`, where it is at first (m, rad).
    """

    name: str
    model: Any
    robot: Robot
    arm_qpos: np.ndarray
    arm_dofs: np.ndarray
    arm_actuators: np.ndarray
    arm_geoms: np.ndarray
    forbidden: np.ndarray
    T_world_object: np.ndarray
    cylinder: Cylinder | None
    joint: str
    start: float

    def data(self, q: np.ndarray) -> Any:
        """A `mujoco.MjData` with the arm at rest at `q` [n], everything else where it is at first, forward computed.

        **Raises** `ConfigurationError` if `q` is not [n], or in collision with what must not be touched or with the
        arm itself.
        """
        mujoco = import_mujoco()
        q = np.asarray(q, float)
        if q.shape != (self.robot.num_joints,) or not np.isfinite(q).all():
            raise ConfigurationError(f"q is {q.tolist()}, expected {self.robot.num_joints} finite joint positions.")
        data = mujoco.MjData(self.model)
        self.place(data, self.T_world_object)
        data.qpos[self.model.joint(self.joint).qposadr[0]] = self.start
        data.qpos[self.arm_qpos] = q
        mujoco.mj_forward(self.model, data)
        touched = self.contacts(data)
        if touched:
            raise ConfigurationError(
                f"the start {np.round(q, 3).tolist()} is in collision: {', '.join(touched)}. Start elsewhere, or move "
                "the object."
            )
        return data

    def place(self, data: Any, T_world_object: np.ndarray) -> None:
        """Put the object, and all furniture with it, at a pose [4, 4]; the cylinder too, on the floor.

        It takes effect with MuJoCo's next step. **Raises** `RigidTransformError`.
        """
        T = check_rigid(T_world_object)
        self.move_object(data, T)
        if self.cylinder is not None:
            data.mocap_pos[1], data.mocap_quat[1] = self._cylinder_foot(T), [1.0, 0.0, 0.0, 0.0]

    def move_object(self, data: Any, T_world_object: np.ndarray) -> None:
        """As `place`, but the cylinder stays where it is, and the pose is not checked."""
        data.mocap_pos[0], data.mocap_quat[0] = T_world_object[:3, 3], quaternion_of_rotation(T_world_object[:3, :3])

    def object_pose(self, data: Any) -> np.ndarray:
        """`T_world_object` [4, 4], the frame that skills speak of."""
        return pose(data.mocap_pos[0], rotation_of_quaternion(data.mocap_quat[0]))

    def joint_position(self, data: Any) -> float:
        """Where the furniture's joint is: how far the drawer stands open, m; the door's angle, rad."""
        return float(data.qpos[self.model.joint(self.joint).qposadr[0]])

    def contacts(self, data: Any) -> list[str]:
        """What the arm touches and must not, itself included, as "geometry of the arm's body - other geometry"."""
        m, found = self.model, set()
        forbidden, arm = set(self.forbidden.tolist()), set(self.arm_geoms.tolist())
        for a, b in data.contact.geom[data.contact.dist < 0].tolist():
            a, b = (a, b) if a in arm else (b, a)
            if a in arm and (b in forbidden or b in arm):
                other = m.geom(b).name or m.body(int(m.geom_bodyid[b])).name
                found.add(f"{m.body(int(m.geom_bodyid[a])).name} - {other}")
        return sorted(found)

    def clearance(self, data: Any) -> float:
        """Least distance of the arm's geometry to what it must not touch, the floor aside, m; at most 1."""
        mujoco = import_mujoco()
        m, least = self.model, _FAR
        x, reach = data.geom_xpos, m.geom_rbound
        for b in self.forbidden:
            if m.geom_type[b] == mujoco.mjtGeom.mjGEOM_PLANE:
                continue
            near = np.linalg.norm(x[self.arm_geoms] - x[b], axis=1) - reach[self.arm_geoms] - reach[b]
            for a in self.arm_geoms[near < least]:
                least = min(least, mujoco.mj_geomDistance(m, data, int(a), int(b), least, None))
        return float(least)

    def obstacles(self, T_world_object: np.ndarray | None = None) -> World:
        """What the policy is told to avoid, as a `World`: the cylinder as the capsule that it is, or nothing."""
        if self.cylinder is None:
            return World()
        foot = self._cylinder_foot(self.T_world_object if T_world_object is None else np.asarray(T_world_object))
        r, up = self.cylinder.radius, np.array([0.0, 0.0, 1.0])
        return World(capsules=Capsules.of([(foot + r * up, foot + (self.cylinder.height - r) * up, r)]))

    def with_object(self, T_world_object: np.ndarray) -> "Scene":
        """The same scene with the object elsewhere at first; the model is shared."""
        return replace(self, T_world_object=check_rigid(T_world_object))

    def with_cylinder(self, center: tuple[float, float]) -> "Scene":
        """The same scene with the cylinder elsewhere in the object's frame; the model is shared."""
        if self.cylinder is None:
            raise ConfigurationError(f"scene {self.name!r} has no cylinder to move: use scene 'drawer_obstacle'.")
        return replace(self, cylinder=self.cylinder._replace(center=(float(center[0]), float(center[1]))))

    def _cylinder_foot(self, T: np.ndarray) -> np.ndarray:
        assert self.cylinder is not None
        foot = T[:3, :3] @ [*self.cylinder.center, 0.0] + T[:3, 3]
        return np.array([foot[0], foot[1], 0.0])


def scene(name: str, *, T_world_object: np.ndarray | None = None, cylinder: Cylinder | None = None) -> Scene:
    """Build a scene: the Panda before a drawer, the same with a cylinder in the way, or before an open cabinet door.

    Everything is of planes, capsules and boxes, downloads nothing and loads in MJX too.

    **Arguments**: `name`, one of `SCENES`; `T_world_object` [4, 4], where the object stands, the frame that the skill
    speaks of (`Skill.T_world_object`), by default where the recorded demonstrations have it; `cylinder`, of
    `drawer_obstacle` only, default `Cylinder()`.
    **Raises** `UnknownNameError` for another name; `RigidTransformError`; `ConfigurationError` for a cylinder that
    makes no sense there; `MissingDependencyError` without mujoco.
    """
    if name not in SCENES:
        raise UnknownNameError("scene", name, SCENES)
    if cylinder is not None and name != "drawer_obstacle":
        raise ConfigurationError(f"scene {name!r} takes no cylinder: use 'drawer_obstacle'.")
    if name == "drawer_obstacle":
        cylinder = cylinder or Cylinder()
        if not (cylinder.radius > 0 and cylinder.height > 2 * cylinder.radius):
            raise ConfigurationError(f"{cylinder}: expected a positive radius and a height of more than twice that.")
    door = name == "door"
    T = _default_pose(door) if T_world_object is None else check_rigid(T_world_object)
    spec, arm_names = _spec(name, T, cylinder)
    robot, model = panda(), spec.compile()
    joints = [model.joint(joint) for joint in robot.joint_names]
    touching = np.flatnonzero((model.geom_conaffinity > 0) & (model.geom_contype == 0))
    wanted = {"drawer_handle", "drawer_front"}
    forbidden = [g for g in touching if model.geom(g).name not in wanted and model.geom(g).name not in arm_names]
    return Scene(
        name=name,
        model=model,
        robot=robot,
        arm_qpos=np.array([j.qposadr[0] for j in joints]),
        arm_dofs=np.array([j.dofadr[0] for j in joints]),
        arm_actuators=np.arange(len(joints)),
        arm_geoms=np.array([model.geom(n).id for n in arm_names]),
        forbidden=np.array(forbidden),
        T_world_object=T,
        cylinder=cylinder,
        joint=DOOR_JOINT if door else DRAWER_JOINT,
        start=0.0 if door else OPENING,
    )


def picture_model(place: Scene, meshes: str | os.PathLike | None = None) -> Any:
    """The model of a scene as it is drawn: with the looks of Menagerie's Panda where they are at hand, else as it is.

    States of one are states of the other. **Arguments**: `meshes`, the MJCF file, by default `panda_meshes()`.
    **Raises** `RobotError` for a file that is not that.
    """
    meshes = meshes or panda_meshes()
    if meshes is None:
        return place.model
    spec, _ = _spec(place.name, place.T_world_object, place.cylinder)
    add_meshes(spec, meshes)
    return spec.compile()


def _spec(name: str, T: np.ndarray, cylinder: Cylinder | None) -> tuple[Any, list[str]]:
    """The editable model, and the names of the arm's geometries."""
    spec = arm_spec()
    arm = [g for body in spec.bodies[1:] for g in body.geoms]
    for i, geom in enumerate(arm):
        geom.name = geom.name or f"arm_{i}"
    arm_names = [geom.name for geom in arm]
    thing = add_object(spec, T)
    if name == "door":
        add_door(spec, thing)
        add_camera(spec, T[:3, 3] + [-1.15, -0.95, 0.5], T[:3, 3] + [0.15, 0.1, -0.1])
    else:
        add_drawer(spec, thing)
        add_camera(spec, T[:3, 3] + [0.75, 1.15, 0.75], T[:3, 3] + [-0.25, 0.15, 0.05])
    if cylinder is not None:
        _add_cylinder(spec, cylinder)
    return spec, arm_names


def _default_pose(door: bool) -> np.ndarray:
    return pose(_DOOR_POSE, rotation_of_vector([0.0, 0.0, _DOOR_YAW])) if door else pose(_DRAWER_POSE, np.eye(3))


def _add_cylinder(spec: Any, cylinder: Cylinder) -> None:
    mujoco = import_mujoco()
    body = spec.worldbody.add_body(name="cylinder", mocap=True)
    r, h = cylinder.radius, cylinder.height
    seen = {"rgba": [0.8, 0.3, 0.2, 1.0], "contype": 0, "conaffinity": 0}
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, pos=[0, 0, h / 2], size=[r, h / 2, 0], **seen)
    body.add_geom(
        name="obstacle",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, r, 0, 0, h - r],
        size=[r, 0, 0],
        rgba=[0.8, 0.3, 0.2, 0.0],
        contype=0,
        conaffinity=1,
    )
