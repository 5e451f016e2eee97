"""What a depth image shows, as points to be looked at: each the object's, the robot's, or neither's."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import matmul
from ._camera import Camera
from ._nearest import nearest, parts_at
from ._object_model import ObjectModel
from ._rays import rays_at
from ._settings import ObjectTrackerSettings
from ._track import Estimate

_NONE = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)

OTHER = 0
OBJECT = 1
ROBOT = 2
"""Whose a point is: neither's, the object's, the robot's."""


class MeasuredPoints(NamedTuple):
    """`points` [N, 3] of the world, m; `known` [N], whether there was depth; `whose` [N], `OTHER`, `OBJECT` or
    `ROBOT`."""

    points: jax.Array
    known: jax.Array
    whose: jax.Array


def measured_points(
    model: ObjectModel,
    settings: ObjectTrackerSettings,
    estimate: Estimate,
    depth: jax.Array,
    camera: Camera,
    centers: Any = (),
    radii: Any = (),
    stride: int = 10,
) -> MeasuredPoints:
    """The points of every `stride`-th pixel of every `stride`-th row of a depth image, and whose they are.

    The object's are those within the first of the settings' `gates` of it where the `estimate` has it; none while that
    is lost. The robot's are those that its spheres hold, as `track` leaves them out, and no others.

    **Arguments**: `model`, `settings`, `camera` as of `track`; `estimate`, after the image; `depth` [height, width], m;
    `centers` [K, 3], `radii` [K], spheres that hold the robot, in the world, m; `stride`, pixels.
    """
    uv = np.stack(np.meshgrid(range(0, camera.width, stride), range(0, camera.height, stride)), axis=-1).reshape(-1, 2)
    rays = rays_at(depth, camera, uv, np.ones(len(uv), bool), *_NONE, 0.0)  # the robot's too
    p, z = jnp.stack(rays.points, axis=1), rays.depth
    T = jnp.asarray(camera.T_world_camera, z.dtype)
    centers = jnp.reshape(jnp.asarray(centers, z.dtype), (-1, 3))
    wide = jnp.reshape(jnp.asarray(radii, z.dtype), (-1,)) + settings.robot_margin
    robots = (jnp.sum((p[:, None] - centers) ** 2, axis=-1) < wide**2).any(1)
    T_object = jnp.asarray(estimate.T_world_object, z.dtype)
    local, eye = (matmul(x - T_object[:3, 3], T_object[:3, :3]) for x in (p, T[:3, 3]))
    parts = parts_at(model, jnp.asarray(estimate.q, z.dtype))
    found = nearest(model, parts, (local[:, 0], local[:, 1], local[:, 2]), (eye[0], eye[1], eye[2]))
    objects = (jnp.abs(found.distance) < settings.gates[0]) & ~estimate.lost
    return MeasuredPoints(p, rays.known, jnp.where(robots, ROBOT, jnp.where(objects, OBJECT, OTHER)))
