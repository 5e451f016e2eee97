"""A depth camera: where its pixels look."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, ShapeError
from .._pytree import as_floats, pytree, set_field, static
from .._ranges import Positive
from .._task_map import check_rigid


@pytree
class Camera:
    """A pinhole camera, as OpenCV and ROS describe one: z forwards, x to the right, y down.

    A point [x, y, z] of its frame is seen at the pixel `(fx x / z + cx, fy y / z + cy)`; pixel (0, 0) has its middle at
    (0, 0). A depth image holds z, not the distance.

    **Arguments**: `focal` [2], fx and fy, pixels; `middle` [2], cx and cy, pixels; `T_world_camera` [4, 4], m; `width`,
    `height`, pixels.
    **Raises** `ShapeError`, `RigidTransformError` for a pose that is none, `ConfigurationError` for a size that is not
    positive.

    >>> camera = Camera.of(640, 480, fovy=45.0)
    >>> camera.pixel(jnp.array([0.0, 0.0, 2.0]))[0].tolist()
    [319.5, 239.5]
    """

    focal: Positive[Any]
    middle: Any
    T_world_camera: Any = None
    width: int = static(default=640)
    height: int = static(default=480)

    def __post_init__(self):
        T = np.eye(4) if self.T_world_camera is None else self.T_world_camera
        for name, value, shape in (("focal", self.focal, (2,)), ("middle", self.middle, (2,))):
            value = as_floats(value)
            if value.shape != shape:
                raise ShapeError(f"{name} of Camera has shape {value.shape}, expected {shape}.")
            set_field(self, name, value)
        if np.shape(T) != (4, 4):
            raise ShapeError(f"T_world_camera has shape {np.shape(T)}, expected (4, 4).")
        set_field(self, "T_world_camera", T if isinstance(T, jax.Array) else check_rigid(T, "T_world_camera"))
        if self.width < 1 or self.height < 1:
            raise ConfigurationError(f"a camera of {self.width} x {self.height} pixels: expected one at least.")

    @classmethod
    def of(cls, width: int, height: int, fovy: float, T_world_camera: Any = None) -> "Camera":
        """A camera of `width` x `height` square pixels at `T_world_camera`: `fovy` degrees from top to bottom."""
        focal = 0.5 * height / np.tan(np.radians(fovy) / 2)
        return cls(np.array([focal, focal]), np.array([width - 1, height - 1]) / 2, T_world_camera, width, height)

    @classmethod
    def looking(cls, eye: Any, target: Any, width: int = 640, height: int = 480, fovy: float = 45.0) -> "Camera":
        """A camera at `eye` that looks at `target` [3], m, the world's z upwards in its picture.

        `width`, `height`, pixels; `fovy`, degrees from top to bottom.

        **Raises** `ConfigurationError` where it would look straight up or down.
        """
        eye, forward = np.asarray(eye, float), np.asarray(target, float) - np.asarray(eye, float)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        if np.linalg.norm(right) < 1e-9:
            raise ConfigurationError("a camera that looks along the vertical has no upwards: move its eye a little.")
        z, x = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), eye
        return cls.of(width, height, fovy, T)

    def pixel(self, p_camera: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The pixel [..., 2] at which points [..., 3] of the camera's frame are seen, and whether one sees them.

        `p_camera`, m; what is behind the camera, or beside its picture, is not seen.
        """
        z = p_camera[..., 2]
        ahead = z > 1e-6
        inverse = 1 / jnp.where(ahead, z, 1)
        uv = p_camera[..., :2] * inverse[..., None] * jnp.asarray(self.focal, z.dtype) + jnp.asarray(
            self.middle, z.dtype
        )
        inside = (uv > -0.5) & (uv < jnp.asarray([self.width, self.height], z.dtype) - 0.5)
        return uv, ahead & inside.all(-1)

    def points(self, uv: jax.Array, depth: jax.Array) -> jax.Array:
        """The points [..., 3] of the camera's frame that are seen at pixels `uv` [..., 2] at `depth` [...], m."""
        flat = (uv - jnp.asarray(self.middle, depth.dtype)) / jnp.asarray(self.focal, depth.dtype)
        return jnp.concatenate([flat * depth[..., None], depth[..., None]], axis=-1)
