"""Grids of signed distances, several at a time: padded to one shape, so that one program does for all."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..world import FAR, SignedDistanceGrid, World
from ..world._components import Point, rotated, to_local
from ..world._obstacles import LARGEST, with_fields


def of_one_shape(worlds: Sequence[World]) -> list[World]:
    """The same `worlds`, their grids padded to as many points as the largest has along each axis.

    What is padded is what a grid says beyond its border: the border's value plus the distance to it.
    """
    shapes = [grid.values.shape for world in worlds for grid in world.grids]
    if len(shapes) < 2:
        return list(worlds)
    shape = np.max(shapes, axis=0)
    padded = [tuple(_padded(grid, shape) for grid in world.grids) for world in worlds]
    return [with_fields(world, grids=grids) if grids else world for world, grids in zip(worlds, padded, strict=True)]


def _padded(grid: SignedDistanceGrid, shape: np.ndarray) -> SignedDistanceGrid:
    values = np.asarray(grid.values)
    at = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    border = np.minimum(at, np.array(values.shape) - 1)
    beyond = float(grid.spacing) * np.linalg.norm(at - border, axis=-1)
    found = values[border[..., 0], border[..., 1], border[..., 2]] + beyond
    return with_fields(grid, values=found.astype(values.dtype))


def about(grid: SignedDistanceGrid, local: Point) -> jax.Array:
    """The value at the grid's point nearest to each of some points of its own frame, three [...]."""
    dtype = local[0].dtype
    flat: Any = 0
    for x, o, n in zip(local, jnp.asarray(grid.origin, dtype), grid.values.shape, strict=True):
        cell = jnp.round((x - o) / jnp.asarray(grid.spacing, dtype))
        flat = flat * n + jnp.clip(cell, 0, n - 1).astype(jnp.int32)
    return jnp.asarray(grid.values, dtype).reshape(-1)[flat]


def distance_and_slope(grid: SignedDistanceGrid, p: Point) -> tuple[jax.Array, Point]:
    """Signed distances [N] of points, three [N], and their gradients, of a grid between whose points lines run."""
    dtype = p[0].dtype
    origin, spacing = jnp.asarray(grid.origin, dtype), jnp.asarray(grid.spacing, dtype)
    cells = [(x - o) / spacing for x, o in zip(to_local(grid.T_world_grid, p), origin, strict=True)]
    inside = [jnp.clip(u, 0, n - 1) for u, n in zip(cells, grid.values.shape, strict=True)]
    # Exactly 0 inside: u - clip(u) is not where a compiler computes u twice, with other roundings.
    off = [
        spacing * (jnp.maximum(u - (n - 1), 0) + jnp.minimum(u, 0))
        for u, n in zip(cells, grid.values.shape, strict=True)
    ]
    beyond = jnp.sqrt(jnp.maximum(off[0] ** 2 + off[1] ** 2 + off[2] ** 2, 1e-20))
    low = [jnp.clip(jnp.floor(v), 0, n - 2) for v, n in zip(inside, grid.values.shape, strict=True)]
    s, t, r = (v - k for v, k in zip(inside, low, strict=True))
    (_, ny, nz), (i, j, k) = grid.values.shape, (x.astype(jnp.int32) for x in low)
    first = (i * ny + j) * nz + k
    corners = first[..., None] + np.array([0, 1, nz, nz + 1, ny * nz, ny * nz + 1, ny * nz + nz, ny * nz + nz + 1])
    v = jnp.asarray(grid.values, dtype).reshape(-1)[corners]
    known = (jnp.abs(v) <= LARGEST).all(-1)
    v = jnp.where(known[..., None], v, 0)
    along_z = v[..., 0::2] + r[..., None] * (v[..., 1::2] - v[..., 0::2])
    along_y = along_z[..., 0::2] + t[..., None] * (along_z[..., 1::2] - along_z[..., 0::2])
    value = along_y[..., 0] + s * (along_y[..., 1] - along_y[..., 0])
    rise_y, rise_z = along_z[..., 1::2] - along_z[..., 0::2], v[..., 1::2] - v[..., 0::2]
    rise_z = rise_z[..., 0::2] + t[..., None] * (rise_z[..., 1::2] - rise_z[..., 0::2])
    slopes = [
        along_y[..., 1] - along_y[..., 0],
        rise_y[..., 0] + s * (rise_y[..., 1] - rise_y[..., 0]),
        rise_z[..., 0] + s * (rise_z[..., 1] - rise_z[..., 0]),
    ]
    # Beyond the border the distance to it is added, and what lies along it does not change.
    g = [jnp.where(o == 0, slope / spacing, o / beyond) for o, slope in zip(off, slopes, strict=True)]
    g = tuple(jnp.where(known, slope, 0) for slope in g)
    d = jnp.where(known, value + jnp.where(beyond > 1e-9, beyond, 0), FAR)
    return d, rotated(jnp.asarray(grid.T_world_grid, dtype), g, back=True)  # type: ignore[arg-type]
