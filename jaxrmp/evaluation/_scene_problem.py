"""A skill in a scene: what its policy avoids there, and the distances that are watched."""

import numpy as np

from .._rotations import pose
from ..kinematics import Robot
from ..kinematics._mujoco import import_mujoco
from ..learning import Skill
from ..policies import whole_arm_policy
from ..scenes import Scene
from ..simulation import Problem
from ..world import Boxes, Capsules, HalfSpaces, ObstacleDistances, RobotSpheres, World, panda_spheres
from ._evaluate import skill_problem

_STANDING = ("panda_link0", "panda_link1")  # on the floor, as they must be


def scene_problem(skill: Skill, robot: Robot, scene: Scene) -> Problem:
    """What `evaluate` rolls out in a scene: the whole arm's policy, which avoids its obstacles.

    Distances to the furniture are watched too: it counts where it is at first, and what the skill is to touch (the
    drawer's front and handle) does not count. Spheres cover the arm and stick out of it by 1.4 cm, so that a distance
    is never too large.
    """
    spheres = panda_spheres()
    tree = whole_arm_policy(skill, robot).tree(skill.T_world_object, scene.obstacles())
    movers = [i for i, frame in enumerate(spheres.frames) if frame not in _STANDING]
    moving = RobotSpheres(
        tuple(spheres.frames[i] for i in movers), np.asarray(spheres.offsets)[movers], np.asarray(spheres.radii)[movers]
    )
    distances = ObstacleDistances(moving.points(robot), scene_world(scene), moving.radii)
    return skill_problem(skill, robot, tree=tree, distances=(distances,))


def scene_world(scene: Scene) -> World:
    """What the arm must not touch in a scene, where it is at first."""
    mujoco = import_mujoco()
    m, data = scene.model, mujoco.MjData(scene.model)
    scene.place(data, scene.T_world_object)
    data.qpos[m.joint(scene.joint).qposadr[0]] = scene.start
    mujoco.mj_kinematics(m, data)
    boxes, capsules, half_spaces = [], [], []
    for g in scene.forbidden:
        T = pose(data.geom_xpos[g], data.geom_xmat[g].reshape(3, 3))
        size, up, kind = m.geom_size[g], T[:3, 2], m.geom_type[g]
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            boxes.append((T, size))
        elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            capsules.append((T[:3, 3] - size[1] * up, T[:3, 3] + size[1] * up, size[0]))
        elif kind == mujoco.mjtGeom.mjGEOM_PLANE:
            half_spaces.append((up, float(up @ T[:3, 3])))
    return World(boxes=Boxes.of(boxes), capsules=Capsules.of(capsules), half_spaces=HalfSpaces.of(half_spaces))
