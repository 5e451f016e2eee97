"""A scene's furniture on the page, moved with its object, and how near the arm is to it."""

from typing import Any

import numpy as np

from .._rotations import rotation_of_quaternion
from ..kinematics._mujoco import import_mujoco
from ..scenes import Scene
from ._poses import place
from ._shapes import add_shape, shapes_of


class FurnitureView:
    """The furniture of a scene below one node at the object's pose. What its joint moves stands where it is at first.

    What the arm's way there would change in the world, such as a drawer that closes, is for physics: `jaxrmp run`.
    """

    def __init__(self, server: Any, scene: Scene):
        mujoco = import_mujoco()
        self._scene, self._data = scene, scene.with_object(np.eye(4)).fresh()
        mujoco.mj_kinematics(scene.model, self._data)
        self._node = server.scene.add_frame("/object", show_axes=False)
        model, bodies = scene.model, set[int]()
        for b in range(1, model.nbody):
            if model.body(b).name == scene.object or int(model.body_parentid[b]) in bodies:
                bodies.add(b)
        geoms = [g for g in range(model.ngeom) if int(model.geom_bodyid[g]) in bodies]
        for i, shape in enumerate(shapes_of(model, geoms)):
            pose = {"position": self._data.xpos[shape.body], "wxyz": self._data.xquat[shape.body]}
            add_shape(server.scene, f"/object/shape_{i}", shape, flat_shading=True, side="double", **pose)

    def move(self, T_world_object: np.ndarray) -> None:
        """Put the object, and all that stands with it, at a pose [4, 4]."""
        place(self._node, T_world_object)

    def clearance(self, q: np.ndarray, T_world_object: np.ndarray) -> float:
        """Least distance of the arm's geometry at `q` [n] to what it must not touch, as `Scene.clearance`, m."""
        mujoco, scene, data = import_mujoco(), self._scene, self._data
        scene.move_object(data, T_world_object)
        data.qpos[scene.arm_qpos] = q
        mujoco.mj_kinematics(scene.model, data)
        return scene.clearance(data)


def camera_of(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Where the scene's own camera stands, and a point that it looks at, both [3], m."""
    cameras = [camera for camera in map(scene.model.camera, range(scene.model.ncam)) if camera.name == "view"]
    if not cameras:
        middle = scene.T_world_object[:3, 3]
        return middle + [1.2, 1.2, 0.8], middle
    camera = cameras[0]
    eye = np.array(camera.pos, float)
    return eye, eye - 1.6 * rotation_of_quaternion(camera.quat)[:, 2]
