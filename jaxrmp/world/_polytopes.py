"""Convex solids as polytopes that hold them, for covering with spheres."""

import math
from typing import NamedTuple

import numpy as np

from .._errors import ConfigurationError

_FACETS = 250  # a hull of more is simplified, for speed
_CORNERS, _DIRECTIONS = 24, 400  # of the prism about a cylinder; of the polytope about an ellipsoid
_POINTS = 400  # of a hull of more, these are taken that are farthest along as many directions
_THICK = 1e-5  # m: flatter hulls are taken as this thick on each side
_TOO_FLAT = "a solid is too flat or too small to be covered with spheres: give a thicker one."


class Polytope(NamedTuple):
    """A convex solid C and a polytope P that holds it: `normals @ x <= offsets`, with the corners `corners` [V, 3].

    The depth in C of a point is at least the least of `inner_offsets - inner_normals @ x`, which are C's own facets, or
    those of P less what P exceeds C by.
    """

    normals: np.ndarray
    offsets: np.ndarray
    corners: np.ndarray
    inner_normals: np.ndarray
    inner_offsets: np.ndarray

    def depth(self, points: np.ndarray) -> np.ndarray:
        """How deep `points` [N, 3] lie in the solid at least, m; below zero outside it."""
        return (self.inner_offsets - points @ self.inner_normals.T).min(axis=1)

    def moved(self, rotation: np.ndarray, position: np.ndarray) -> "Polytope":
        """In another frame, in which its own has this pose."""
        normals, inner = self.normals @ rotation.T, self.inner_normals @ rotation.T
        corners = self.corners @ rotation.T + position
        return Polytope(
            normals, self.offsets + normals @ position, corners, inner, self.inner_offsets + inner @ position
        )


def box(half_extents: np.ndarray) -> Polytope:
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    normals, offsets = np.concatenate([np.eye(3), -np.eye(3)]), np.tile(half_extents, 2)
    return Polytope(normals, offsets, signs * half_extents, normals, offsets)


def cylinder(radius: float, half_length: float) -> Polytope:
    """A prism about it; the axis is z."""
    angles = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    sides = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    outer = radius / math.cos(np.pi / _CORNERS)
    turned = angles + np.pi / _CORNERS
    rim = np.stack([outer * np.cos(turned), outer * np.sin(turned), half_length + 0 * angles], axis=1)
    normals = np.concatenate([sides, [[0, 0, 1.0], [0, 0, -1.0]]])
    offsets = np.r_[np.full(_CORNERS, radius), half_length, half_length]
    excess = np.r_[np.full(_CORNERS, outer - radius), 0, 0]
    return Polytope(normals, offsets, np.concatenate([rim, rim * [1, 1, -1]]), normals, offsets - excess)


def ellipsoid(radii: np.ndarray) -> Polytope:
    """Its tangent planes, where evenly spread points of the unit sphere are taken to."""
    normals = _sphere(_DIRECTIONS) / radii
    offsets = 1 / np.linalg.norm(normals, axis=1)
    normals *= offsets[:, None]
    corners = corners_of(normals, offsets, np.zeros(3))
    outside = np.linalg.norm(corners, axis=1) * (1 - 1 / np.linalg.norm(corners / radii, axis=1))
    return Polytope(normals, offsets, corners, normals, offsets - outside.max())


def hull(points: np.ndarray, tolerance: float) -> Polytope:
    """The convex hull of `points` [V, 3].

    Of many points, the depth is that in the hull of those farthest along some directions, which is within; the polytope
    has the same facets, moved outwards. Of many facets, it has those that it takes to go beyond by about `tolerance`.
    """
    from scipy.spatial import ConvexHull

    middle = points.mean(axis=0)
    axes = np.linalg.eigh(np.cov((points - middle).T))[1]
    local = (points - middle) @ axes
    thin = np.ptp(local, axis=0) < 2 * _THICK
    for axis in np.flatnonzero(thin):
        step = _THICK * np.eye(3)[axis]
        local = np.concatenate([local - step, local + step])
    local = local[ConvexHull(local).vertices]
    far, found = local, ConvexHull(local)
    if len(local) > _POINTS:
        far = local[np.unique(_farthest(far, _sphere(_POINTS))[1])]
        found = ConvexHull(far)
    normals = _distinct(found.equations[:, :3])
    corners, offsets = far[found.vertices], _farthest(local, normals)[0]
    inner = (normals @ corners.T).max(axis=1)
    solid = Polytope(normals, offsets, corners, normals, inner)
    if (offsets > inner).any() or len(normals) > _FACETS:
        solid = _simplified(solid, local, tolerance)
    return solid.moved(axes, middle)


def _farthest(points: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far the points reach along each direction, and which does."""
    reach, which = np.full(len(directions), -np.inf), np.zeros(len(directions), int)
    for first in range(0, len(points), 1000):  # few at a time, which stay in the processor's cache
        along = directions @ points[first : first + 1000].T
        best = along.argmax(axis=1)
        value = along[np.arange(len(directions)), best]
        reach, which = np.maximum(reach, value), np.where(value > reach, first + best, which)
    return reach, which


def _sphere(count: int) -> np.ndarray:
    """Directions spread evenly, by Fibonacci's spiral."""
    k = np.arange(count) + 0.5
    polar, around = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    return np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], axis=1)


def _distinct(normals: np.ndarray) -> np.ndarray:
    """Facets in one plane, which come as triangles, once."""
    return normals[np.unique(np.round(normals, 7), axis=0, return_index=True)[1]]


def _simplified(solid: Polytope, points: np.ndarray, tolerance: float) -> Polytope:
    """Fewer of its facets: those of a box, then again and again the ones that corners are beyond most."""
    chosen = {int(np.argmax(solid.normals @ way)) for way in np.concatenate([np.eye(3), -np.eye(3)])}
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    offsets = _farthest(points, normals)[0]
    middle = solid.corners.mean(axis=0)
    while True:
        rows = sorted(chosen)
        own, bounds = np.concatenate([normals, solid.normals[rows]]), np.concatenate([offsets, solid.offsets[rows]])
        corners = corners_of(own, bounds, middle)
        beyond = corners @ solid.normals.T - solid.offsets
        worst, most = beyond.argmax(axis=1), beyond.max(axis=1)
        new = set(worst[most > tolerance].tolist()) - chosen
        if not new:
            return Polytope(own, bounds, corners, solid.inner_normals, solid.inner_offsets)
        chosen |= new


def corners_of(normals: np.ndarray, offsets: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The corners [V, 3] of `normals @ x <= offsets`, of which `inside` is a point well inside."""
    from scipy.spatial import HalfspaceIntersection, QhullError

    for more in (0.0, 1e-7, 1e-6, 1e-5):  # m: where planes meet too flat to be told apart, a little farther out
        try:
            corners = HalfspaceIntersection(np.c_[normals, -offsets - more], inside).intersections
        except QhullError:
            continue
        if np.isfinite(corners).all():
            return corners
    raise ConfigurationError(_TOO_FLAT)


def inner_ball(normals: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, float]:
    """The centre and radius of the largest ball in `normals @ x <= offsets`, the radius below zero if there is none."""
    from scipy.optimize import linprog

    found = linprog([0, 0, 0, -1], np.c_[normals, np.ones(len(normals))], offsets, bounds=[(None, None)] * 4)
    if found.status != 0:  # never for what is bounded, but by rounding: a cell must not be taken for empty then
        raise ConfigurationError(_TOO_FLAT)
    return found.x[:3], float(found.x[3])
