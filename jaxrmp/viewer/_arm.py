"""The arm on the page: a node for each link, its geometry below it, its collision spheres if they are wanted."""

import warnings
from typing import Any

import numpy as np

from .._errors import FileWarning, RobotError
from .._rotations import quaternion_of_rotation
from ..kinematics import Robot, panda
from ..world import RobotSpheres, geometry_of_model
from ._shapes import Shape, add_shape, seen, shapes_of
from ._skeleton import skeleton

_STILL = 1e-6  # m, and of a rotation's entries: what has moved by less has not
_SPHERES = (230, 120, 30)
_HAND, _LINKS = (90, 100, 112), ((238, 240, 243), (206, 213, 222))


class ArmView:
    """A robot drawn from the geometry of its file, moved by the poses of frames.

    `frames`, those whose poses `move` wants, in its order; `more` frames may be asked for, that carry nothing. Where
    there is no geometry, or it cannot be read, the robot is drawn as a skeleton, with a warning; `note` says why.
    """

    def __init__(self, server: Any, robot: Robot, spheres: RobotSpheres | None, more: tuple[str, ...] = ()):
        shapes, self.note = _looks(robot)
        carried = [name for name, _ in shapes] + list(spheres.frames if spheres else ()) + list(more)
        self.frames = tuple(name for name in dict.fromkeys(carried) if name in robot.frame_names)
        scene = server.scene
        self._nodes = {name: scene.add_frame(f"/arm/{name}", show_axes=False) for name in self.frames}
        self._poses = np.full((len(self.frames), 4, 4), np.inf)
        tinted: dict[str, tuple[int, int, int]] = {}
        if robot.fingerprint == panda().fingerprint:  # two light greys in turn, and a dark one for the hand
            links = dict.fromkeys(name for name, _ in shapes)
            arm = [name for name in links if "hand" not in name and "finger" not in name]
            tinted = dict.fromkeys(links, _HAND) | {name: _LINKS[k % 2] for k, name in enumerate(arm)}
        for i, (name, shape) in enumerate(shapes):
            add_shape(scene, f"/arm/{name}/shape_{i}", shape, tinted.get(name))
        covered = dict.fromkeys(spheres.frames) if spheres else ()
        self._spheres = [_sphere_node(scene, name, spheres) for name in covered]

    def move(self, poses: np.ndarray) -> None:
        """Put the links at `poses` [F, 4, 4] of `frames`; the page is told of those that move."""
        moved = np.abs(poses - self._poses).max(axis=(1, 2)) > _STILL
        self._poses[moved] = poses[moved]
        for k, wxyz in zip(np.flatnonzero(moved), quaternion_of_rotation(poses[moved, :3, :3]), strict=True):
            node = self._nodes[self.frames[k]]
            node.position, node.wxyz = poses[k, :3, 3], wxyz

    def show_spheres(self, visible: bool) -> None:
        """Show the collision spheres, or hide them."""
        for node in self._spheres:
            node.visible = visible


def _looks(robot: Robot) -> tuple[list[tuple[str, Shape]], str]:
    """The shapes on the robot's links, by their names, and why they are a skeleton's, if they are."""
    try:
        model = geometry_of_model(robot, looks=True)
        named = [(model.body(shape.body).name, shape) for shape in shapes_of(model, seen(model))]
        shapes = [(name, shape) for name, shape in named if name in robot.model.frame_of_name]  # it may be a branch
        why = f"{robot.source} has no geometry."
    except RobotError as error:
        shapes, why = [], str(error)
    if shapes:
        return shapes, ""
    warnings.warn(f"{robot.name!r} is drawn as a skeleton: {why}", FileWarning, stacklevel=3)
    return [(robot.model.bodies[s.body].name, s) for s in skeleton(robot)], f"drawn as a skeleton: {why}"


def _sphere_node(scene: Any, name: str, spheres: RobotSpheres) -> Any:
    from trimesh import creation

    ball = creation.icosphere(subdivisions=2)
    rows = [k for k, frame in enumerate(spheres.frames) if frame == name]
    return scene.add_batched_meshes_simple(
        f"/arm/{name}/spheres",
        np.asarray(ball.vertices),
        np.asarray(ball.faces),
        batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1)),
        batched_positions=np.asarray(spheres.offsets)[rows],
        batched_scales=np.asarray(spheres.radii)[rows],
        batched_colors=_SPHERES,
        opacity=0.35,
        lod="off",
        cast_shadow=False,
        visible=False,
    )
