"""What a depth image says of where an object is: normal equations, and how well each link is seen."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from .._linalg import matmul
from ..kinematics._scalars import sub3
from ..world._components import Point
from ._camera import Camera
from ._nearest import Found, jacobian, nearest, parts_at
from ._noise import KINECT, DepthNoise, axial_sigma
from ._object_model import ObjectModel
from ._rays import Rays
from ._see_through import seen_through
from ._settings import ObjectTrackerSettings


class Evidence(NamedTuple):
    """`information` [6 + n, 6 + n] and `gradient` [6 + n] of half the squared residuals, by a displacement of the base,
    a turn about its middle, and the joints; `fits`, `through` [L], for each link the points that are its own within
    noise, and the rays that go through it; `rms`, m, of the distances that fit."""

    information: jax.Array
    gradient: jax.Array
    fits: jax.Array
    through: jax.Array
    rms: jax.Array


def evidence(
    model: ObjectModel,
    settings: ObjectTrackerSettings,
    camera: Camera,
    rays: Rays,
    R: jax.Array,
    t: jax.Array,
    q: jax.Array,
    gate: jax.Array,
    noise: DepthNoise = KINECT,
    outlines: bool = True,
) -> Evidence:
    """The evidence of `rays` for the object's base at `R` [3, 3], `t` [3], m, and its joints at `q` [n].

    Two residuals a ray: the distance of its point to the nearest part, over what the depth's noise makes of it; and
    where it goes through a part, how far it is from that part's outline. Both by Geman and McClure, of a scale of three
    standard deviations and the `gate`, m: what is far from all parts has no say.

    **Arguments**: `model`, the object; `settings`; `camera`, which took the image; `noise`, its;
    `outlines`, whether rays that go through a part count, which takes longer than all else.
    """
    dtype = t.dtype
    p = _to_base(R, t, rays.points)
    eye = matmul(R.T, jnp.asarray(camera.T_world_camera, dtype)[:3, 3] - t)
    camera_at = (eye[0], eye[1], eye[2])
    parts = parts_at(model, q)
    found = nearest(model, parts, p, camera_at)
    way = sub3(p, camera_at)
    inverse = 1 / rays.depth
    sigma_z = axial_sigma(noise, rays.depth).astype(dtype)
    across = _dot(found.gradient, way) * inverse * sigma_z
    variance = across * across + settings.model_error**2
    weight = _weights(found.distance, variance, gate, 1.0)
    weight = jnp.where(rays.known, weight, 0)
    rows, weights = jnp.stack(_columns(model, parts, found)), weight
    through = jnp.zeros(len(model.links), dtype)
    if outlines:
        before = 1 - (settings.clearance + 4 * sigma_z) * inverse
        outline = seen_through(parts, p, camera_at, before)
        pixel = 0.3 * rays.depth / jnp.asarray(camera.focal, dtype)[0]
        through_weight = _weights(outline.distance, pixel * pixel + settings.outline_error**2, gate, 2.0)
        crossed = rays.known & (outline.distance < 0)
        through_weight = jnp.where(crossed, through_weight, 0)
        rows = jnp.concatenate([rows, jnp.stack(_columns(model, parts, outline))], axis=1)
        weights = jnp.concatenate([weight, through_weight])
        through = _of_links(model, outline, crossed & (outline.distance < -settings.through), dtype)
    product = matmul(rows * weights, rows.T)
    fits = rays.known & (found.distance * found.distance < 9 * variance)
    count = jnp.maximum(jnp.sum(fits), 1)
    return Evidence(
        product[:-1, :-1],
        product[:-1, -1],
        _of_links(model, found, fits, dtype),
        through,
        jnp.sqrt(jnp.sum(jnp.where(fits, found.distance * found.distance, 0)) / count),
    )


def _columns(model: ObjectModel, parts, found: Found) -> list[jax.Array]:
    return [*jacobian(model, parts, found), found.distance]


def _weights(d: jax.Array, variance: jax.Array, gate: jax.Array, wider: float) -> jax.Array:
    """Weights of Geman and McClure over the variance; none beyond four scales."""
    square = d * d
    scale = 9 * variance + (wider * gate) ** 2
    share = scale / (scale + square)
    near = square < 16 * scale
    return jnp.where(near, share * share / variance, 0)


def _of_links(model: ObjectModel, found: Found, which: jax.Array, dtype) -> jax.Array:
    return jnp.stack([jnp.sum(which & (found.link == k), dtype=jnp.int32) for k in range(len(model.links))]).astype(
        dtype
    )


def _to_base(R: jax.Array, t: jax.Array, p: Point) -> Point:
    a, b, c = p[0] - t[0], p[1] - t[1], p[2] - t[2]
    x, y, z = (R[0, i] * a + R[1, i] * b + R[2, i] * c for i in range(3))
    return x, y, z


def _dot(u: Point, v: Point) -> jax.Array:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
