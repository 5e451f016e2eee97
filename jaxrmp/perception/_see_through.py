"""Where the camera sees through an object's parts: the outline that they would have is then elsewhere."""

from typing import Any

import jax
import jax.numpy as jnp

from ..world import Boxes, Capsules, Cylinders, SignedDistanceGrid, Spheres
from ..world._components import Point, along, difference, to_local
from ._grids import about, distance_and_slope
from ._nearest import Found, Parts, in_box, out_of_box, over_shapes, visible_sides

_SAMPLES, _FINER = 16, 9  # along a ray through a grid, and round the best of them


def seen_through(parts: Parts, p: Point, camera: Point, before: jax.Array) -> Found:
    """How deep each ray from a camera to a point runs within the outline of a part that it should have met.

    Points on a plane say nothing about where on it the plane ends; a ray that goes on beyond it does. It counts where
    it enters a part nearer to the camera than the fraction `before` [N] of the way to its point. Minus the distance
    across the ray to the part's outline is the `distance`, 0 where nothing is met; `at`, where on the ray that is.

    **Arguments**: `p`, three [N], and `camera`, three numbers, in the base's frame. Half-spaces are left out.
    """

    def evaluate(shape: Any) -> tuple[jax.Array, Point, Point]:
        if isinstance(shape, Boxes):
            return _box(shape, p, camera, before)
        if isinstance(shape, Spheres | Capsules | Cylinders):
            return _round(shape, p, camera, before)
        if isinstance(shape, SignedDistanceGrid):
            return _grid(shape, p, camera, before)
        zero = jnp.zeros_like(p[0])
        return zero, (zero, zero, zero), p

    def better(new: jax.Array, old: jax.Array) -> jax.Array:
        return new < old

    return over_shapes(parts, p, evaluate, better, 0.0)


def _round(shape: Any, p: Point, eye: Any, before: jax.Array) -> tuple[jax.Array, Point, Point]:
    """Of a shape whose least distance along a ray is across it: where it is not a flat end, which is rarely."""
    a = tuple(jnp.broadcast_to(x, y.shape)[:, None] for x, y in zip(eye, p, strict=True))
    end = along(a, before[:, None], difference(tuple(x[:, None] for x in p), a))  # type: ignore[arg-type]
    x = along(a, shape.nearest_on_segment(a, end), difference(end, a))  # type: ignore[arg-type]
    gradient, _ = shape.derivatives(x, tuple(jnp.zeros_like(c) for c in x))
    d = jnp.minimum(shape.distance(x), 0)
    g = tuple(jnp.broadcast_to(c, d.shape)[:, 0] for c in gradient)
    return d[:, 0], g, tuple(c[:, 0] for c in x)  # type: ignore[return-value]


def _grid(shape: SignedDistanceGrid, p: Point, eye: Any, before: jax.Array) -> tuple[jax.Array, Point, Point]:
    """The least distance along a ray, where it runs in the grid: of some samples, and of more between their best."""
    dtype = p[0].dtype
    a = tuple(jnp.broadcast_to(x, y.shape) for x, y in zip(eye, p, strict=True))
    start, end = to_local(shape.T_world_grid, a), to_local(shape.T_world_grid, p)
    enters, leaves = jnp.zeros_like(before), before
    for o, e, n, first in zip(start, end, shape.values.shape, jnp.asarray(shape.origin, dtype), strict=True):
        way = jnp.where(jnp.abs(e - o) > 1e-9, e - o, 1e-9)
        last = first + (n - 1) * jnp.asarray(shape.spacing, dtype)
        sides = (first - o) / way, (last - o) / way
        enters = jnp.maximum(enters, jnp.minimum(*sides))
        leaves = jnp.minimum(leaves, jnp.maximum(*sides))
    met = enters < leaves
    way = difference(end, start)

    def least(low: jax.Array, high: jax.Array, count: int) -> jax.Array:
        slots = low[:, None] + (high - low)[:, None] * jnp.linspace(0, 1, count, dtype=dtype)
        d = about(shape, tuple(o[:, None] + slots * w[:, None] for o, w in zip(start, way, strict=True)))
        return jnp.take_along_axis(slots, jnp.argmin(d, axis=1)[:, None], axis=1)[:, 0]

    width = (leaves - enters) / (_SAMPLES - 1)
    best = least(enters, leaves, _SAMPLES)
    best = least(jnp.maximum(best - width, enters), jnp.minimum(best + width, leaves), _FINER)
    at = along(a, best, difference(p, a))  # type: ignore[arg-type]
    d, gradient = _grid_at(shape, at)
    return jnp.where(met, jnp.minimum(d, 0), 0), gradient, at  # type: ignore[return-value]


def _grid_at(shape: SignedDistanceGrid, p: Any) -> tuple[jax.Array, Point]:
    if not shape.smooth:
        return distance_and_slope(shape, p)
    x: Any = tuple(c[:, None] for c in p)
    gradient, _ = shape.derivatives(x, tuple(jnp.zeros_like(c) for c in x))
    a, b, c = (jnp.broadcast_to(g, x[0].shape)[:, 0] for g in gradient)
    return shape.distance(x)[:, 0], (a, b, c)


def _box(shape: Boxes, p: Point, eye: Any, before: jax.Array) -> tuple[jax.Array, Point, Point]:
    """The outline of a box is of edges between a face that is seen and one that is not: along each axis two of them.

    Looked at along an axis, a box is a rectangle, and those edges its two corners that a ray may just pass.
    """
    local, half = in_box(shape, p)
    eye = in_box(shape, eye)[0]
    way = difference(local, eye)
    safe = [jnp.where(jnp.abs(w) > 1e-9, w, 1e-9) for w in way]
    low = [(-h - o) / w for h, o, w in zip(half, eye, safe, strict=True)]
    high = [(h - o) / w for h, o, w in zip(half, eye, safe, strict=True)]
    enters = jnp.maximum(jnp.maximum(*map(jnp.minimum, low[:2], high[:2])), jnp.minimum(low[2], high[2]))
    leaves = jnp.minimum(jnp.minimum(*map(jnp.maximum, low[:2], high[:2])), jnp.maximum(low[2], high[2]))
    met = (enters < leaves) & (enters > 0) & (enters < before)
    seen = visible_sides(half, eye)
    least, slot = jnp.full_like(p[0], jnp.inf), jnp.zeros_like(p[0])
    zero = jnp.zeros_like(p[0])
    gradient = [zero, zero, zero]
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        size = way[i] * way[i] + way[j] * way[j]
        inverse = jax.lax.rsqrt(jnp.maximum(size, 1e-12))
        (sees_i, side_i), (sees_j, side_j) = seen[i], seen[j]
        for sign in (1, -1):
            # Both faces seen: the corners beside the one between them. One seen: its two corners.
            a = jnp.where(sees_i, jnp.where(sees_j, sign * side_i, side_i), sign) * half[i]
            b = jnp.where(sees_j, jnp.where(sees_i, -sign * side_j, side_j), sign) * half[j]
            to_i, to_j = a - eye[i], b - eye[j]
            across = (to_j * way[i] - to_i * way[j]) * inverse
            depth = jnp.where(sees_i | sees_j, jnp.abs(across), jnp.inf)
            nearer = depth < least
            outwards = jnp.where(across >= 0, inverse, -inverse)
            least = jnp.where(nearer, depth, least)
            slot = jnp.where(nearer, (to_i * way[i] + to_j * way[j]) * inverse * inverse, slot)
            gradient[i] = jnp.where(nearer, -way[j] * outwards, gradient[i])
            gradient[j] = jnp.where(nearer, way[i] * outwards, gradient[j])
            gradient[k] = jnp.where(nearer, 0, gradient[k])
    met = met & (least < jnp.inf)
    d = jnp.where(met, -least, 0)
    at = along(tuple(jnp.asarray(e) for e in eye), slot, way)  # type: ignore[arg-type]
    T = jnp.asarray(shape.T_world_box, p[0].dtype)[0]
    x, y, z = (c + T[i, 3] for i, c in enumerate(out_of_box(shape, at)))
    return d, out_of_box(shape, (gradient[0], gradient[1], gradient[2])), (x, y, z)
