"""What a depth camera measures and believes, as nodes of a page."""

from typing import Any

import numpy as np

from .._rotations import quaternion_of_rotation
from ..kinematics._body_poses import body_poses
from ..perception import OBJECT, OTHER, ROBOT, Camera, Estimate, MeasuredPoints, ObjectModel
from ..scenes import Scene
from ._poses import place
from ._shapes import shapes_of

_COLOURS = np.zeros((3, 3), np.uint8)
_COLOURS[[OTHER, OBJECT, ROBOT]] = (110, 110, 110), (230, 97, 1), (0, 114, 178)
_SEEN, _LOST = (0, 158, 115), (170, 60, 160)
_SIZE = 0.006  # m, of a point


class DepthNodes:
    """The camera, a board before it, the points that it measures, and the object where the tracker believes it is.

    **Arguments**: `server`; `scene`, with the object; `model`, the tracker's of it; `camera`; `board`, m before it.
    """

    def __init__(self, server: Any, scene: Scene, model: ObjectModel, camera: Camera, board: float):
        page, self._model, self._lost = server.scene, model, False
        focal = float(np.asarray(camera.focal)[1])
        size = np.array([camera.width, camera.height]) / focal
        node = page.add_camera_frustum(
            "/camera",
            2 * float(np.arctan(size[1] / 2)),
            camera.width / camera.height,
            scale=0.12,
            thickness=0.002,
            cast_shadow=False,
        )
        place(node, np.asarray(camera.T_world_camera, float))
        self._board = page.add_box(
            "/camera/board",
            dimensions=(*(board * size), 0.01),
            position=(0.0, 0.0, board),
            color=(120, 90, 60),
            cast_shadow=False,
            visible=False,
        )
        self._points = page.add_point_cloud(
            "/measured", np.zeros((0, 3)), np.zeros((0, 3), np.uint8), point_size=_SIZE, point_shading="flat"
        )
        page.add_frame("/estimate", show_axes=False)
        m = scene.model
        names = [m.body(b).name or f"body_{b}" for b in range(m.nbody)]
        bodies = {names.index(body.name): k for k, body in enumerate(model.robot.model.bodies)}
        self._links = {k: page.add_frame(f"/estimate/{k}", show_axes=False) for k in bodies.values()}
        self._shapes = [
            page.add_mesh_simple(
                f"/estimate/{bodies[shape.body]}/shape_{i}",
                shape.vertices,
                shape.faces,
                color=_SEEN,
                opacity=0.4,
                side="double",
                flat_shading=shape.flat,
                cast_shadow=False,
                receive_shadow=False,
            )
            for i, shape in enumerate(shapes_of(m, [g for g in range(m.ngeom) if int(m.geom_bodyid[g]) in bodies]))
        ]

    def board(self, visible: bool) -> None:
        """Show the board, or take it away."""
        self._board.visible = visible

    def points(self, found: MeasuredPoints, visible: bool) -> None:
        """Draw the points that were `found`, each in the colour of whose it is."""
        self._points.visible = visible
        if not visible:
            return
        known = np.asarray(found.known)
        self._points.points = np.asarray(found.points, np.float32)[known]
        self._points.colors = _COLOURS[np.asarray(found.whose)[known]]

    def estimate(self, estimate: Estimate, visible: bool) -> None:
        """Put the object's parts where the `estimate` has them; in another colour while it is lost."""
        T = np.asarray(estimate.T_world_object, float)
        poses = body_poses(self._model.robot.model, np.asarray(estimate.q, float)[None])
        for k, node in self._links.items():
            at = T @ poses[k][0]
            node.wxyz, node.position, node.visible = quaternion_of_rotation(at[:3, :3]), at[:3, 3], visible
        lost = bool(estimate.lost)
        if lost != self._lost:
            self._lost = lost
            for shape in self._shapes:
                shape.color = _LOST if lost else _SEEN
