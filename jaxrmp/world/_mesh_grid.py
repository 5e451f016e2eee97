"""Signed distances of a triangle mesh, on a grid."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from .._errors import ConfigurationError, ShapeError
from .._ranges import require_number
from ._grid import SignedDistanceGrid

_BAND, _LONGEST = 1.8, 4.0  # spacings: how far from the surface distances are exact, and edges of triangles cut up
_CHUNK = 1_000_000  # pairs of triangles and points at a time
_MOST = 20_000_000  # points of a grid
_OFF = np.array([0.3183, 0.4142, 0.2361])  # spacings, so that no line of the grid meets an edge of the mesh


def grid_of_mesh(vertices: Any, faces: Any, spacing: float = 0.004, margin: int = 4) -> SignedDistanceGrid:
    """The signed distances of a mesh of triangles: a `SignedDistanceGrid` with straight lines between its points.

    Within 1.8 spacings of the surface they are exact, farther away they are those to points of the surface a few
    spacings apart. A point is inside where most of the grid's three lines through it say so, by the triangles that they
    cross, turned either way; a line that goes in and never comes out says nothing, so that meshes may have holes.

    **Arguments**: `vertices` [V, 3], m; `faces` [F, 3], their corners as indices; `spacing`, between the grid's points,
    m; `margin`, how many of them are free round the mesh.
    **Raises** `ShapeError`, `ConfigurationError` for a spacing that is not positive, or too small for so large a mesh.
    """
    vertices, faces = np.asarray(vertices, float), np.asarray(faces)
    require_number("grid_of_mesh", "spacing", spacing)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise ShapeError(f"a mesh of vertices {vertices.shape} and faces {faces.shape}, expected [V, 3] and [F, 3].")
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise ConfigurationError("a mesh has vertices that are not finite, or faces of vertices that are not there.")
    triangles = vertices[faces]
    low, high = triangles.min((0, 1)), triangles.max((0, 1))
    origin = low - (margin + _OFF) * spacing
    shape = np.ceil((high - origin) / spacing).astype(int) + margin + 1
    if shape.prod() > _MOST:
        raise ConfigurationError(
            f"a grid of {' x '.join(map(str, shape))} points, {spacing} m apart, for a mesh of "
            f"{np.round(high - low, 3).tolist()} m: have them farther apart."
        )
    cells = _cut((triangles - origin) / spacing)
    distance = _distances(cells, shape)
    inside = _inside(cells, shape)
    values = (spacing * np.where(inside, -distance, distance)).astype(np.float32)
    return SignedDistanceGrid(values, origin, spacing, smooth=False)


def _cut(triangles: np.ndarray) -> np.ndarray:
    """Triangles [F, 3, 3], halved across their longest edges until these are short."""
    done = []
    while len(triangles):
        edges = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        long = edges.max(1) > _LONGEST
        done.append(triangles[~long])
        order = (edges[long].argmax(1)[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(triangles[long], order[:, :, None], axis=1), 1, 0)
        middle = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


def _pairs(low: np.ndarray, high: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Of boxes of whole numbers `low` to `high` [F, k], which box, and the numbers in it [P, k], chunk by chunk."""
    sides = np.maximum(high - low + 1, 0)
    counts = sides.prod(1)
    ends = np.cumsum(counts)
    start = 0
    while start < len(low):
        stop = max(int(np.searchsorted(ends, (ends[start - 1] if start else 0) + _CHUNK, "right")), start + 1)
        which = np.repeat(np.arange(start, stop), counts[start:stop])
        place = np.arange(len(which)) - np.repeat(ends[start:stop] - counts[start:stop], counts[start:stop])
        place += ends[start - 1] if start else 0
        at = []
        for k in reversed(range(low.shape[1])):
            at.append(low[which, k] + place % sides[which, k])
            place = place // sides[which, k]
        yield which, np.stack(at[::-1], axis=1)
        start = stop


def _distances(triangles: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Distances of all points of the grid to the triangles, all in spacings."""
    from scipy.spatial import KDTree

    squares = np.full(int(shape.prod()), np.inf)
    low = np.maximum(np.ceil(triangles.min(1) - _BAND), 0).astype(int)
    high = np.minimum(np.floor(triangles.max(1) + _BAND), shape - 1).astype(int)
    for which, at in _pairs(low, high):
        flat = np.ravel_multi_index(at.T, tuple(shape))
        np.minimum.at(squares, flat, _to_triangle(at.astype(float), triangles, which))
    near = squares <= _BAND**2
    far = np.stack(np.unravel_index(np.flatnonzero(~near), tuple(shape)), axis=1)
    d, _ = KDTree(_thinned(triangles.reshape(-1, 3))).query(far)
    squares[~near] = np.minimum(squares[~near], np.maximum(d, _BAND) ** 2)
    return np.sqrt(squares).reshape(shape)


def _thinned(points: np.ndarray) -> np.ndarray:
    """One of the `points` in each cell three spacings wide."""
    _, first = np.unique(np.floor(points / 3).astype(int), axis=0, return_index=True)
    return points[first]


def _to_triangle(p: np.ndarray, triangles: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Squared distances [P] of points [P, 3], each to one of the triangles, `which` [P]."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    uu, uv, vv = (ab * ab).sum(1), (ab * ac).sum(1), (ac * ac).sum(1)
    size = uu * vv - uv * uv
    flat = size < 1e-12
    inverse = np.where(flat, 0, 1 / np.where(flat, 1, size))
    of = {name: value[which] for name, value in dict(ab=ab, ac=ac, uu=uu, uv=uv, vv=vv, inverse=inverse).items()}
    to = p - a[which]
    u, v = _dot(to, of["ab"]), _dot(to, of["ac"])
    s = (of["vv"] * u - of["uv"] * v) * of["inverse"]
    t = (of["uu"] * v - of["uv"] * u) * of["inverse"]
    square = _dot(to, to)
    found = square - 2 * (s * u + t * v) + s * s * of["uu"] + 2 * s * t * of["uv"] + t * t * of["vv"]
    # Beyond its edges, or of no area, the nearest edge counts: a to b, a to c, and b to c.
    beyond = np.flatnonzero((s < 0) | (t < 0) | (s + t > 1) | flat[which])
    u, v, square, uu, uv, vv = (x[beyond] for x in (u, v, square, of["uu"], of["uv"], of["vv"]))
    along = vv - 2 * uv + uu
    edges = _to_edge(square, u, uu), _to_edge(square, v, vv), _to_edge(square - 2 * u + uu, v - u - uv + uu, along)
    found[beyond] = np.minimum(np.minimum(edges[0], edges[1]), edges[2])
    return np.maximum(found, 0)


def _to_edge(square: np.ndarray, on: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Squared distance to an edge, from that to its start, the product with its way, and its squared length."""
    share = np.clip(on / np.maximum(length, 1e-18), 0, 1)
    return square - 2 * share * on + share * share * length


def _dot(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[:, 0] * v[:, 0] + u[:, 1] * v[:, 1] + u[:, 2] * v[:, 2]


def _inside(triangles: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Which points of the grid [nx, ny, nz] are inside, by most of the lines through each."""
    says, of = np.zeros(shape, np.int8), np.zeros(shape, np.int8)
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        flat, along = triangles[:, :, others], triangles[:, :, axis]
        area = _area(flat[:, 0], flat[:, 1], flat[:, 2])
        use = np.abs(area) > 1e-12
        flat, along, area = flat[use], along[use], area[use]
        low, high = np.ceil(flat.min(1)).astype(int), np.floor(flat.max(1)).astype(int)
        turns = np.zeros(tuple(shape[[*others, axis]] + np.array([0, 0, 1])), np.int32)
        for which, at in _pairs(low, high):
            corners, p = flat[which], at.astype(float)
            shares = np.stack([_area(corners[:, (k + 1) % 3], corners[:, (k + 2) % 3], p) for k in range(3)], axis=1)
            shares /= area[which, None]
            hit = (shares >= 0).all(1)
            depth = (shares[hit] * along[which[hit]]).sum(1)
            place = (at[hit, 0], at[hit, 1], np.ceil(depth).astype(int))
            np.add.at(turns, place, np.where(area[which[hit]] > 0, 1, -1))
        turns = np.cumsum(turns, axis=2)
        knows = turns[:, :, -1:] == 0
        of += np.moveaxis(np.broadcast_to(knows, turns[:, :, :-1].shape), 2, axis)
        says += np.moveaxis(knows & (turns[:, :, :-1] != 0), 2, axis)
    return 2 * says > of


def _area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed area of triangles in the plane."""
    u, v = b - a, c - a
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
