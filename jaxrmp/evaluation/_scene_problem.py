"""A skill in a scene: what its policy avoids there, and the distances that are watched."""

from .._errors import ConfigurationError
from .._rotations import pose
from ..kinematics import Robot
from ..kinematics._mujoco import import_mujoco
from ..learning import Skill
from ..policies import whole_arm_policy
from ..scenes import Scene
from ..simulation import Problem
from ..world import Boxes, Capsules, HalfSpaces, ObstacleDistances, Spheres, World, spheres_from_model
from ._evaluate import skill_problem


def scene_problem(skill: Skill, robot: Robot, scene: Scene) -> Problem:
    """What `evaluate` rolls out of a `skill` in a `scene`: the policy of the whole `robot`, which avoids obstacles.

    Distances to the furniture are watched too: it counts where it is at first, and what the skill is to touch
    (`Scene.may_touch`) does not count, nor do those parts of the arm that stand on something. Spheres cover the arm and
    stick out of it by 1.5 cm at most, so that a distance is never too large.
    """
    tree = whole_arm_policy(skill, robot).tree(skill.T_world_object, scene.obstacles())
    bodies = {scene.model.body(b).name for b in scene.model.geom_bodyid[scene.arm_geoms]}
    spheres = spheres_from_model(scene.model, 0.015, frames=sorted(bodies - set(scene.standing)))
    distances = ObstacleDistances(spheres.points(robot), scene_world(scene), spheres.radii)
    return skill_problem(skill, robot, tree=tree, distances=(distances,))


def scene_world(scene: Scene) -> World:
    """What the arm must not touch in a `scene`, where it is at first."""
    mujoco = import_mujoco()
    m, data = scene.model, scene.fresh()
    mujoco.mj_kinematics(m, data)
    boxes, capsules, half_spaces, spheres = [], [], [], []
    for g in scene.forbidden:
        T = pose(data.geom_xpos[g], data.geom_xmat[g].reshape(3, 3))
        size, up, kind = m.geom_size[g], T[:3, 2], m.geom_type[g]
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            boxes.append((T, size))
        elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            capsules.append((T[:3, 3] - size[1] * up, T[:3, 3] + size[1] * up, size[0]))
        elif kind == mujoco.mjtGeom.mjGEOM_PLANE:
            half_spaces.append((up, float(up @ T[:3, 3])))
        elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            spheres.append((T[:3, 3], size[0]))
        else:
            raise ConfigurationError(
                f"scene {scene.name!r}: geometry {m.geom(int(g)).name!r} is no box, capsule, sphere or plane, to which "
                "distances could be watched. Build it of those, or let it touch nothing (contype and conaffinity 0)."
            )
    return World(
        spheres=Spheres.of(spheres),
        boxes=Boxes.of(boxes),
        capsules=Capsules.of(capsules),
        half_spaces=HalfSpaces.of(half_spaces),
    )
