"""Points on the surfaces of shapes, and round them."""

import dataclasses
from typing import Any

import numpy as np

from .._errors import NoGeometryError
from ..world import World


def surface_points(world: World, count: int, margin: float, rng: np.random.Generator) -> np.ndarray:
    """`count` points [count, 3] on the surfaces of the shapes of a `world`, each moved by up to `margin`, m, anyhow.

    Of every shape as many as the square root of its area says, so that small ones have some. Half-spaces have none.
    """
    shapes = _shapes(world)
    if not shapes:
        raise NoGeometryError("half-spaces alone cannot be looked for: give the object a shape that ends somewhere.")
    share = np.sqrt([area for area, _ in shapes])
    which = rng.choice(len(shapes), count, p=share / share.sum())
    points = np.zeros((count, 3))
    for k, (_, draw) in enumerate(shapes):
        rows = np.flatnonzero(which == k)
        points[rows] = draw(len(rows), rng)
    return points + rng.uniform(-margin, margin, points.shape)


def _shapes(world: World) -> list[tuple[float, Any]]:
    """Area of every shape, m^2, and a function of how many points that draws them on it."""
    found: list[tuple[float, Any]] = []
    for kind, draw in ((world.boxes, _box), (world.cylinders, _cylinder), (world.capsules, _capsule)):
        for fields in zip(*_fields(kind), strict=True) if kind is not None else ():
            found.append(draw(*fields))
    for center, radius in zip(*_fields(world.spheres), strict=True) if world.spheres is not None else ():
        found.append(_capsule(center, center, radius))
    for grid in world.grids:
        found.append(_grid(grid))
    return found


def _fields(kind: Any) -> list[np.ndarray]:
    return [np.asarray(getattr(kind, f.name), float) for f in dataclasses.fields(kind)[: len(kind._blank)]]


def _box(T: np.ndarray, half: np.ndarray) -> tuple[float, Any]:
    x, y, z = half
    areas = np.array([y * z, x * z, x * y])

    def draw(n, rng):
        p = rng.uniform(-1, 1, (n, 3))
        axis = rng.choice(3, n, p=areas / areas.sum())
        p[np.arange(n), axis] = np.sign(p[np.arange(n), axis])
        return p * half @ T[:3, :3].T + T[:3, 3]

    return 8 * float(areas.sum()), draw


def _cylinder(T: np.ndarray, radius: Any, half: Any) -> tuple[float, Any]:
    side, ends = 4 * np.pi * radius * half, 2 * np.pi * radius**2

    def draw(n, rng):
        turn, on_side = rng.uniform(0, 2 * np.pi, n), rng.uniform(size=n) < side / (side + ends)
        r = np.where(on_side, radius, radius * np.sqrt(rng.uniform(size=n)))
        z = np.where(on_side, rng.uniform(-half, half, n), half * rng.choice([-1, 1], n))
        return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1) @ T[:3, :3].T + T[:3, 3]

    return float(side + ends), draw


def _capsule(start: np.ndarray, end: np.ndarray, radius: Any) -> tuple[float, Any]:
    length = float(np.linalg.norm(end - start))

    def draw(n, rng):
        way = rng.normal(size=(n, 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        return start + rng.uniform(size=(n, 1)) * (end - start) + radius * way

    return float(2 * np.pi * radius * length + 4 * np.pi * radius**2), draw


def _grid(grid: Any) -> tuple[float, Any]:
    values, spacing, T = np.asarray(grid.values), float(grid.spacing), np.asarray(grid.T_world_grid)
    near = np.argwhere(np.abs(values) <= spacing)
    if not len(near):
        raise NoGeometryError("a SignedDistanceGrid that is nowhere within a spacing of zero has no surface.")

    def draw(n, rng):
        local = np.asarray(grid.origin) + spacing * near[rng.integers(len(near), size=n)]
        return local @ T[:3, :3].T + T[:3, 3]

    return float(len(near) / 2 * spacing**2), draw
