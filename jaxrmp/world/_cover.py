"""Covering solids with spheres: every point of the solid lies in a sphere, and no sphere sticks out far."""

import math
from collections.abc import Callable

import numpy as np

from .._errors import ConfigurationError

Cover = tuple[np.ndarray, np.ndarray, float]
"""Centres [K, 3], radii [K], and how far the spheres stick out of the solid at most, m."""

_MOST = 4096
_SUPPORT_STEPS = 300


def cover_capsule(radius: float, half_length: float, max_error: float) -> Cover:
    """Spheres along the z axis; a capsule without length is a sphere already."""
    if half_length == 0:
        return np.zeros((1, 3)), np.array([radius]), 0.0
    gap = math.sqrt((radius + max_error) ** 2 - radius**2)  # half the largest distance between neighbours
    count = max(2, math.ceil(half_length / gap - 1e-9) + 1)
    if count > _MOST:
        raise _too_fine(max_error)
    z = np.linspace(-half_length, half_length, count)
    reach = math.hypot(radius, half_length / (count - 1))
    return np.stack([0 * z, 0 * z, z], axis=1), np.full(count, reach), reach - radius


def cover_box(half_extents: np.ndarray, max_error: float) -> Cover:
    """One sphere round each cell of a division into equal cells."""

    def project(centers):
        return centers, np.zeros(len(centers)), (half_extents - np.abs(centers)).min(axis=1)

    return _cover_by_cells(half_extents, max_error, project)


def cover_cylinder(radius: float, half_length: float, max_error: float) -> Cover:
    """Spheres round the cells of the box about it; the axis is z."""

    def project(centers):
        rho = np.hypot(centers[:, 0], centers[:, 1])
        shrink = np.minimum(1, radius / rho.clip(1e-12))
        near = np.stack([centers[:, 0] * shrink, centers[:, 1] * shrink, centers[:, 2]], axis=1)
        return near, np.zeros(len(centers)), np.minimum(radius - rho, half_length - np.abs(centers[:, 2])).clip(0)

    return _cover_by_cells(np.array([radius, radius, half_length]), max_error, project)


def cover_ellipsoid(radii: np.ndarray, max_error: float) -> Cover:
    """As the convex hull of its points, by the support function `|diag(radii) n|`."""
    return _cover_convex(
        lambda n: radii * (n * radii) / np.linalg.norm(n * radii, axis=1, keepdims=True).clip(1e-300), radii, max_error
    )


def cover_convex_hull(vertices: np.ndarray, max_error: float) -> Cover:
    """Spheres that cover the convex hull of `vertices` [V, 3]."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    local = vertices - middle
    centers, radii, error = _cover_convex(lambda n: local[np.argmax(n @ local.T, axis=1)], half, max_error)
    return centers + middle, radii, error


def _cover_convex(support: Callable[[np.ndarray], np.ndarray], half: np.ndarray, max_error: float) -> Cover:
    """Cells of the box `half` about a convex body given by its farthest points along directions [N, 3]."""

    def project(centers):
        """By Frank and Wolfe's method, which ends short of the projection by no more than it says."""
        near, lower = support(centers), np.zeros(len(centers))
        for _ in range(_SUPPORT_STEPS):
            towards = centers - near
            unit = towards / np.linalg.norm(towards, axis=1).clip(1e-12)[:, None]
            far = support(unit)
            lower = np.maximum(lower, np.einsum("ij,ij->i", unit, centers - far))
            step = far - near
            t = np.einsum("ij,ij->i", towards, step) / np.einsum("ij,ij->i", step, step).clip(1e-18)
            near = near + np.clip(t, 0, 1)[:, None] * step
        upper = np.linalg.norm(centers - near, axis=1)
        return near, np.sqrt((upper**2 - lower**2).clip(0)), np.zeros(len(centers))

    return _cover_by_cells(half, max_error, project)


def _cover_by_cells(half: np.ndarray, max_error: float, project: Callable) -> Cover:
    """Cells, ever more, the longest side divided first, until their spheres stick out by no more than `max_error`.

    A sphere round a cell may be moved to the projection of its centre on the convex solid and still covers what the
    cell holds of the solid, since projection brings a point closer to each point of the solid. There it sticks out by
    no more than its radius, less the depth of its centre. `project(centers)` gives points of the solid, how far they
    are from the projections at most, by which the sphere must grow, and a lower bound of their depth.
    """
    counts = np.ones(3, int)
    while True:
        cell = half / counts
        reach = float(np.linalg.norm(cell))
        axes = [(2 * np.arange(n) + 1 - n) * c for n, c in zip(counts, cell, strict=True)]
        centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        if reach - cell.min() <= max_error:
            near, slack, depth = project(centers)
            met = np.linalg.norm(centers - near, axis=1) - slack <= reach
            error = float((reach + slack - depth)[met].max())
            if error <= max_error:
                return near[met], (reach + slack)[met], error
        counts[np.argmax(cell)] += 1
        if counts.prod() > _MOST:
            raise _too_fine(max_error)


def _too_fine(max_error: float) -> ConfigurationError:
    return ConfigurationError(f"max_error={max_error} m needs more than {_MOST} spheres for one geometry: give more.")
