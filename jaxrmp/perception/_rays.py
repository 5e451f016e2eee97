"""What a depth image says at some of its pixels: rays that end at points."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from .._linalg import matmul
from ..kinematics._motion import move
from ..world._components import Point
from ._camera import Camera
from ._object_model import ObjectModel


class Rays(NamedTuple):
    """N rays of a camera: the `points` at which they end, three [N], in the world, m; `depth` [N], along the camera's
    axis, m; `known` [N], whether there is one, and it is not the robot."""

    points: Point
    depth: jax.Array
    known: jax.Array


def pixels_of_object(
    model: ObjectModel,
    camera: Camera,
    R: jax.Array,
    t: jax.Array,
    q: jax.Array,
    frame: jax.Array,
    share: float = 1.0,
) -> tuple[jax.Array, jax.Array]:
    """The pixels [N, 2] where the object's `look` would be seen with its base at `R`, `t` and joints at `q`, the set
    for this `frame`, or a `share` of these; and whether they are in the picture [N]."""
    (motions, _), found = move(model.robot.model, model.links, q), []
    for k, look in zip(model.links, model.look, strict=True):
        motion = motions[k]
        few = max(round(share * look.shape[1]), 1)
        local = jnp.asarray(look[:, :few], t.dtype)[frame % len(look)]
        rotation = jnp.stack([jnp.asarray(r, t.dtype) for r in motion.rotation]).reshape(3, 3)
        place = jnp.stack([jnp.asarray(x, t.dtype) for x in motion.position])
        found.append(matmul(local, rotation.T) + place)
    T = jnp.asarray(camera.T_world_camera, t.dtype)
    p = jnp.concatenate(found)
    p_world = matmul(p, R.T) + t
    uv, seen = camera.pixel(matmul(p_world - T[:3, 3], T[:3, :3]))
    return jnp.where(seen[:, None], jnp.round(uv), 0).astype(jnp.int32), seen


def rays_at(
    depth: jax.Array, camera: Camera, uv: jax.Array, wanted: jax.Array, centers: Any, radii: Any, margin: float
) -> Rays:
    """The rays of pixels `uv` [N, 2] of a `depth` image [height, width], m, without those that end on the robot.

    What is not positive is no depth, nor what is not finite. `centers` [K, 3], `radii` [K], spheres that hold the
    robot, in the world, m, widened by `margin`.
    """
    z = depth.reshape(-1)[uv[:, 1] * camera.width + uv[:, 0]]
    known = wanted & (z > 0) & (z < 1e3)
    z = jnp.where(known, z, 1)
    T = jnp.asarray(camera.T_world_camera, z.dtype)
    p = matmul(camera.points(uv.astype(z.dtype), z), T[:3, :3].T) + T[:3, 3]
    x, y, w = p[:, 0], p[:, 1], p[:, 2]
    centers, wide = jnp.asarray(centers, z.dtype), jnp.asarray(radii, z.dtype) + margin
    for k in range(len(wide)):
        a, b, c = x - centers[k, 0], y - centers[k, 1], w - centers[k, 2]
        known = known & (a * a + b * b + c * c > wide[k] * wide[k])
    return Rays((x, y, w), z, known)
