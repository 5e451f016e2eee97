"""Depth images of MuJoCo models, without a display."""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .._errors import ConfigurationError
from ..kinematics._mujoco import import_mujoco
from ._camera import Camera


@contextlib.contextmanager
def depth_renderer(model: Any, width: int, height: int) -> Iterator[Callable[[Any, Camera], np.ndarray]]:
    """Within it, a function of a `mujoco.MjData` and a `Camera` of that size: the depth [height, width] that it sees.

    **Arguments**: `model`, a `mujoco.MjModel`; `width`, `height`, pixels.
    In m along the camera's axis, single precision; where nothing is, whatever is farthest. MuJoCo must have been told
    how to draw before it is imported (`MUJOCO_GL`), and only one renderer may be open at a time.
    **Raises** `ConfigurationError` where MuJoCo cannot draw, or a camera is of another size.
    """
    mujoco = import_mujoco()
    size = model.vis.global_.offwidth, model.vis.global_.offheight
    if width > size[0] or height > size[1]:
        raise ConfigurationError(f"a picture of {width} x {height} pixels: the model has a buffer of {size}.")
    try:
        renderer = mujoco.Renderer(model, height, width)
    except Exception as error:  # whatever the graphics library raises
        raise ConfigurationError(
            f"MuJoCo cannot draw here ({error}). Without a display: apt-get install -y --no-install-recommends "
            "libosmesa6 (as root) and MUJOCO_GL=osmesa."
        ) from error
    option = mujoco.MjvOption()
    option.sitegroup[:] = 0  # marks, not things

    def depth(data: Any, camera: Camera) -> np.ndarray:
        if (camera.width, camera.height) != (width, height):
            raise ConfigurationError(
                f"a camera of {camera.width} x {camera.height} pixels before a renderer of {width} x {height}."
            )
        renderer.update_scene(data, scene_option=option)
        renderer.scene.flags[:] = 0  # no shadows, no sky, no reflections
        _look(renderer.scene, camera, model)
        return np.array(renderer.render(), np.float32)

    try:
        renderer.enable_depth_rendering()
        yield depth
    finally:
        renderer.close()


def _look(scene: Any, camera: Camera, model: Any) -> None:
    """Let both eyes of MuJoCo's camera see what `camera` sees: pixels' edges are half a pixel beyond their middles."""
    T = np.asarray(camera.T_world_camera, float)
    (fx, fy), (cx, cy) = np.asarray(camera.focal, float), np.asarray(camera.middle, float)
    near = model.vis.map.znear * model.stat.extent
    left, right = near * (-0.5 - cx) / fx, near * (camera.width - 0.5 - cx) / fx
    for eye in scene.camera:
        eye.pos, eye.forward, eye.up = T[:3, 3], T[:3, 2], -T[:3, 1]
        eye.orthographic = 0
        eye.frustum_near, eye.frustum_far = near, model.vis.map.zfar * model.stat.extent
        eye.frustum_top, eye.frustum_bottom = near * (cy + 0.5) / fy, near * (cy - camera.height + 0.5) / fy
        eye.frustum_center, eye.frustum_width = 0.5 * (left + right), 0.5 * (right - left)
