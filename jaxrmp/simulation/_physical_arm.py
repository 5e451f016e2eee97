"""An arm in a MuJoCo model, with what an engine of many rollouts needs of it."""

from typing import Any, NamedTuple

import numpy as np

from ..kinematics import Robot, panda
from ..kinematics._mujoco import import_mujoco
from ..scenes import Scene
from ..scenes._parts import arm_spec


class PhysicalArm(NamedTuple):
    """`model`, a `mujoco.MjModel`; `robot`, the arm in it, of n joints; `positions`, `velocities`, `actuators`, where
    they are in `qpos`, `qvel` and `ctrl`; `qpos` [nq], of everything at the start, the arm aside; `torque_limit`,
    `velocity_limit` [n]."""

    model: Any
    robot: Robot
    positions: np.ndarray
    velocities: np.ndarray
    actuators: np.ndarray
    qpos: np.ndarray
    torque_limit: np.ndarray
    velocity_limit: np.ndarray

    def data(self) -> Any:
        """A new `mujoco.MjData`, everything where it is at the start."""
        data = import_mujoco().MjData(self.model)
        data.qpos[:] = self.qpos
        return data


def arm_alone() -> PhysicalArm:
    """The built-in Panda with nothing around it but its own base."""
    spec = arm_spec()
    spec.delete(spec.geom("floor"))
    robot = panda()
    model = spec.compile()
    return _arm(model, robot, np.array(model.qpos0))


def arm_in_scene(scene: Scene) -> PhysicalArm:
    """The arm of `scene`, the furniture where it stands at first."""
    qpos = np.array(scene.model.qpos0)
    qpos[scene.model.joint(scene.joint).qposadr[0]] = scene.start
    return _arm(scene.model, scene.robot, qpos)


def _arm(model: Any, robot: Robot, qpos: np.ndarray) -> PhysicalArm:
    joints = [model.joint(name) for name in robot.joint_names]
    actuators = np.arange(len(joints))
    return PhysicalArm(
        model=model,
        robot=robot,
        positions=np.array([j.qposadr[0] for j in joints]),
        velocities=np.array([j.dofadr[0] for j in joints]),
        actuators=actuators,
        qpos=qpos,
        torque_limit=np.array(model.actuator_ctrlrange[actuators, 1]),
        velocity_limit=np.asarray(robot.velocity_limit, float),
    )
