"""Covering solids with few spheres: every point of a solid lies in a sphere, and no sphere sticks out far.

A ball round a point c of a convex solid sticks out by its radius less the depth of c: with `max_error` e it may be as
large as `depth(c) + e`. Few such balls that hold sample points of the solids are sought; then the solids are cut into
the balls' power cells, which are polytopes, so that each ball holds its cell if it holds the corners. Corners that it
does not hold are samples of the next round.
"""

import math
from collections.abc import Sequence

import numpy as np

from .._errors import ConfigurationError
from ._polytopes import Polytope, corners_of, inner_ball

Cover = tuple[np.ndarray, np.ndarray, float]
"""Centres [K, 3], radii [K], and how far the spheres stick out of the solid at most, m."""

MOST = 4096


class TooFineError(ConfigurationError):
    """A cover would take more spheres than are allowed."""

    def __init__(self, max_error: float, most: int = MOST):
        super().__init__(f"max_error={max_error} m needs more than {most} spheres: give more.")


_LEAST_SAMPLES, _MOST_SAMPLES, _CANDIDATES = 150, 3000, 1500
_SHARP = 0.97  # cosine of the angle between facets, below which their edge is one
_SEARCHED, _STEPS = 150_000, 100  # balls by samples up to which balls that can go are sought, by steps of descent
_ROUNDS = 30  # of cutting into cells and adding corners; later ones aim lower
_NEIGHBOURS = 200  # balls that bound a cell at most: with fewer it would be larger, and seem to be missed
_NEAREST, _REFRESH = 8, 5  # where there are more, balls that a sample looks at in descent, for so many steps
_ALIKE = 0.1  # parts of the error that solids may differ by in extent to be tried as copies
_MIRRORS = np.stack(np.meshgrid(*[(1.0, -1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)  # the first does nothing
_ROUNDING = 1e-7  # m, that spheres are larger for what the corners' arithmetic loses


def cover_capsule(radius: float, half_length: float, max_error: float) -> Cover:
    """Spheres along the z axis; a capsule without length is a sphere already."""
    if half_length == 0:
        return np.zeros((1, 3)), np.array([radius]), 0.0
    gap = math.sqrt((radius + max_error) ** 2 - radius**2)  # half the largest distance between neighbours
    count = max(2, math.ceil(half_length / gap - 1e-9) + 1)
    if count > MOST:
        raise TooFineError(max_error)
    z = np.linspace(-half_length, half_length, count)
    reach = math.hypot(radius, half_length / (count - 1))
    return np.stack([0 * z, 0 * z, z], axis=1), np.full(count, reach), reach - radius


def cover_polytopes(solids: Sequence[Polytope], max_error: float, most: int = MOST) -> Cover:
    """Spheres that cover convex solids, which may overlap, together.

    **Raises** `TooFineError` if no cover by so many spheres is found.
    """
    samples, candidates = _all_samples(solids, max_error)
    centers = np.zeros((0, 3))
    for turn in range(_ROUNDS):
        aim = max_error * (0.98 - 0.01 * turn)
        if turn:
            centers = _relaxed(solids, samples, centers, aim)[0]
        filled = _filled(solids, samples, centers, candidates, aim, 1.5 * most)
        if len(filled) > 1.5 * most:
            raise TooFineError(max_error, most)
        centers = _fewer(solids, samples, filled, aim) if len(filled) > len(centers) else filled
        found, missed = _certified(solids, samples, centers, max_error)
        if found is not None and len(found[1]) > most:
            raise TooFineError(max_error, most)
        if found is not None:
            return found
        samples = np.concatenate([samples, missed])
    raise TooFineError(max_error, most)


def cover_alike(
    solids: Sequence[Polytope], known: Sequence[tuple[Sequence[Polytope], Cover]], max_error: float
) -> Cover | None:
    """A cover from those of other solids, `known`, of which these seem to be copies or mirror images: certified for
    these. None if there is none."""
    extents = _extents(solids)
    for others, (centers, _, _) in known:
        if len(others) != len(solids):
            continue
        for mirror in _MIRRORS:
            if np.abs(np.sort(_extents(others) * mirror, axis=1) - extents).max() > _ALIKE * max_error:
                continue
            found, _ = _certified(solids, np.concatenate([s.corners for s in solids]), centers * mirror, max_error)
            if found is not None:
                return found
    return None


def _extents(solids: Sequence[Polytope]) -> np.ndarray:
    """The least and the largest coordinates of each solid, [S, 2, 3]."""
    return np.array([[solid.corners.min(axis=0), solid.corners.max(axis=0)] for solid in solids])


def rough_count(solids: Sequence[Polytope], max_error: float, most: float) -> int:
    """About how many spheres a cover takes, from its first step, `most` and one at most.

    **Raises** as `cover_polytopes`.
    """
    samples, candidates = _all_samples(solids, max_error)
    return len(_filled(solids, samples, np.zeros((0, 3)), candidates, max_error, most))


def _all_samples(solids, max_error: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    samples, candidates = zip(*(_samples(solid, max_error, rng) for solid in solids), strict=True)
    return _some(np.concatenate(samples), 2 * _MOST_SAMPLES), np.concatenate(candidates)


def _some(rows: np.ndarray, most: int) -> np.ndarray:
    return rows if len(rows) <= most else rows[np.linspace(0, len(rows) - 1, most).astype(int)]


def _depth(solids: Sequence[Polytope], points: np.ndarray) -> np.ndarray:
    return np.max([solid.depth(points) for solid in solids], axis=0)


def _holds(samples, centers, radii) -> np.ndarray:
    """Whether samples [N] are in balls [K]: [N, K]."""
    return _powers(samples, centers, radii) <= 0


def _powers(points, centers, radii) -> np.ndarray:
    """The squares of the distances of points [N] from the centres of balls [K], less those of the radii: [N, K]."""
    balls = np.c_[-2 * centers, (centers**2).sum(1) - radii**2, np.ones(len(centers))]
    return np.c_[points, np.ones(len(points)), (points**2).sum(1)] @ balls.T


def _distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
    return np.sqrt(square.clip(0))


def _samples(solid: Polytope, max_error: float, rng) -> tuple[np.ndarray, np.ndarray]:
    """Points of the surface and within, corners among them, and centres of the largest balls within that touch it."""
    from scipy.spatial import ConvexHull

    shell = ConvexHull(solid.corners)
    a, b, c = solid.corners[shell.simplices].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    depth = max(inner_ball(solid.inner_normals, solid.inner_offsets)[1], 0.0)
    patch = 2 * depth * max_error + max_error**2  # of the surface that one ball holds, by its radius squared
    if shell.area / patch / 2 > MOST:
        raise TooFineError(max_error)
    count = int(np.clip(20 * shell.area / patch, _LEAST_SAMPLES, _MOST_SAMPLES))
    rows = np.searchsorted(np.cumsum(areas) / areas.sum(), (np.arange(count) + rng.random()) / count)
    rows = rows.clip(max=len(areas) - 1)
    u = rng.random((2, count))
    u = np.where(u.sum(axis=0) > 1, 1 - u, u)
    surface = a[rows] + u[0][:, None] * (b - a)[rows] + u[1][:, None] * (c - a)[rows]
    normals = shell.equations[rows, :3]
    # The ball through p about p - t n, with the normal n there, is within if n' (p - t n) + t <= d' for all facets.
    slack = solid.offsets - surface @ solid.normals.T
    rate = 1 - normals @ solid.normals.T
    t = np.where(rate > 1e-9, slack.clip(0) / rate.clip(1e-9), np.inf).min(axis=1)
    medial = surface - t[:, None] * normals
    candidates = np.concatenate([medial, (surface + medial) / 2, solid.corners.mean(axis=0)[None]])
    edges = _along_sharp_edges(solid.corners, shell, math.sqrt(patch) / 4)
    return np.concatenate([solid.corners, edges, surface, medial[::2]]), candidates[solid.depth(candidates) >= 0]


def _along_sharp_edges(corners: np.ndarray, shell, spacing: float) -> np.ndarray:
    """Points on the edges of a hull, which are farthest from any ball within."""
    first, across = np.repeat(np.arange(len(shell.neighbors)), 3), shell.neighbors.ravel()
    cosine = (shell.equations[first, :3] * shell.equations[across, :3]).sum(axis=1)
    sharp = (first < across) & (cosine < _SHARP)
    opposite = np.tile(np.arange(3), len(shell.neighbors))[sharp]
    rows = shell.simplices[first[sharp]]
    ends = np.stack([rows[np.arange(len(rows)), (opposite + k) % 3] for k in (1, 2)])
    a, b = corners[ends[0]], corners[ends[1]]
    counts = np.minimum(np.linalg.norm(b - a, axis=1) / spacing, 200).astype(int)
    which = np.repeat(np.arange(len(a)), counts)
    part = np.concatenate([(np.arange(n) + 1) / (n + 1) for n in counts]) if len(counts) else np.zeros(0)
    return a[which] + part[:, None] * (b - a)[which]


def _filled(solids, samples, centers, candidates, aim, most) -> np.ndarray:
    """More centres, `most` and one at most, each of the ball that holds most of the samples that none holds yet."""
    if len(centers):
        samples = samples[~_holds(samples, centers, _depth(solids, centers) + aim).any(axis=1)]
    if not len(samples):
        return centers
    candidates = _some(candidates, _CANDIDATES)
    depths = _depth(solids, candidates)
    holds = _holds(samples, candidates, depths + aim)
    alone = ~holds.any(axis=1)
    if alone.any():  # balls near some such samples, on the way to the candidate that nearly holds it, and inwards
        lost = samples[_some(np.flatnonzero(alone), _CANDIDATES // 2)]
        near = candidates[(_distances(candidates, lost) - depths[:, None]).argmin(axis=0)]
        home = np.argmax([solid.depth(lost) for solid in solids], axis=0)
        middles = np.array([solid.corners.mean(axis=0) for solid in solids])[home]
        steps = np.concatenate([near, middles]) - np.tile(lost, (2, 1))
        length = np.linalg.norm(steps, axis=1).clip(1e-12)
        points = np.tile(lost, (2, 1)) + steps * np.minimum(1, 0.7 * aim / length)[:, None]
        depths = _depth(solids, points)
        points, depths = points[depths >= 0], depths[depths >= 0]
        candidates = np.concatenate([candidates, points])
        holds = np.concatenate([holds, _holds(samples, points, depths + aim)], axis=1)
    weight, left = (
        1.0 / holds.sum(axis=1).clip(1),
        np.asarray(holds.any(axis=1)),
    )  # samples that few balls hold count more
    counts, chosen = weight @ holds, []
    while left.any() and len(centers) + len(chosen) <= most:
        chosen.append(int(np.argmax(counts.astype(np.float32))))  # the first of those equal but for rounding
        new = np.flatnonzero(left & holds[:, chosen[-1]])
        left[new] = False
        counts -= weight[new] @ holds[new]
    return np.concatenate([centers, candidates[chosen]])


def _fewer(solids, samples, centers, aim) -> np.ndarray:
    """Without balls that the others, moved a little, can do without."""
    while len(centers) > 1 and len(centers) * len(samples) <= _SEARCHED:
        holds = _holds(samples, centers, _depth(solids, centers) + aim)
        alone = holds[holds.sum(axis=1) == 1].sum(axis=0)
        for least in np.argsort(alone)[:3]:
            rest, value = _relaxed(solids, samples, np.delete(centers, least, axis=0), aim)
            if value <= aim:
                centers = rest
                break
        else:
            break
    return centers


def _relaxed(solids, samples, centers, aim) -> tuple[np.ndarray, float]:
    """Centres moved so that balls that hold the samples stick out by `aim` at most, if they can; and how far they do.

    Each ball descends the distance of its farthest sample less the depth of its centre, both smoothed.
    """
    best, least, count, near = centers, math.inf, len(centers), None
    for turn in range(_STEPS):
        each = np.stack([solid.depth(centers) for solid in solids])
        depths = each.max(axis=0)
        if count * len(samples) > _SEARCHED and turn % _REFRESH == 0:
            near = _nearest(samples, centers, depths + aim, _NEAREST)
        owner, far = _owners(samples, centers, depths, near)
        value = float((far - depths[owner]).max())
        if value < least:
            best, least = centers, value
        if value <= aim:
            break
        if turn in (_STEPS // 4, _STEPS // 2) and least > (1.25 if turn < _STEPS // 2 else 1.1) * aim:
            break
        scale = aim * (0.3 * (1 - turn / _STEPS) + 0.02)
        farthest = np.full(count, -np.inf)
        np.maximum.at(farthest, owner, far)
        weight = np.exp((far - farthest[owner]) / scale)
        total = np.bincount(owner, weight, count).clip(1e-300)
        unit = (samples - centers[owner]) * (weight / far.clip(1e-12))[:, None]
        step = np.stack([np.bincount(owner, unit[:, axis], count) / total for axis in range(3)], axis=1)
        home = each.argmax(axis=0)
        for s in np.unique(home):
            slack = solids[s].inner_offsets - centers[home == s] @ solids[s].inner_normals.T
            tight = np.exp(-(slack - slack.min(axis=1, keepdims=True)) / scale)
            step[home == s] -= tight / tight.sum(axis=1, keepdims=True) @ solids[s].inner_normals
        moved = centers + scale * step
        centers = np.where((_depth(solids, moved) >= 0)[:, None], moved, centers)
    return best, least


def _nearest(points, centers, radii, count: int) -> np.ndarray:
    """For each of `points` [N], the `count` balls of least power: [N, count], or [N] for one."""
    from scipy.spatial import KDTree

    lift = np.sqrt((radii.max() ** 2 - radii**2).clip(0))  # one axis more, in which powers are distances
    return np.asarray(KDTree(np.c_[centers, lift]).query(np.c_[points, np.zeros(len(points))], count)[1])


def _owners(samples, centers, depths, near) -> tuple[np.ndarray, np.ndarray]:
    """The ball [N], of those `near` each sample [N, m] or of all, that sticks out least if it holds it, and how far its
    centre is."""
    rows = np.arange(len(samples))
    if near is None:
        distance = _distances(samples, centers)
        owner = (distance - depths).argmin(axis=1)
        return owner, distance[rows, owner]
    distance = np.linalg.norm(samples[:, None] - centers[near], axis=2)
    which = (distance - depths[near]).argmin(axis=1)
    return near[rows, which], distance[rows, which]


def _certified(solids, samples, centers, max_error) -> tuple[Cover | None, np.ndarray]:
    """The balls as small as their power cells allow, if that is small enough; else none, and the points missed."""
    depths = _depth(solids, centers)
    limits = depths + max_error - _ROUNDING
    reach, missed = np.zeros(len(centers)), []
    for solid in solids:
        distance = _distances(centers, solid.corners)
        whole = np.flatnonzero((distance <= limits[:, None]).all(axis=1))
        if len(whole):
            k = whole[np.argmin(distance[whole].max(axis=1))]
            reach[k] = max(reach[k], distance[k].max())
            continue
        power = distance**2 - limits[:, None] ** 2
        own = samples[(samples @ solid.normals.T <= solid.offsets + 1e-9).all(axis=1)]
        owner = _nearest(own, centers, limits, 1)
        shares = np.bincount(owner, minlength=len(centers)).clip(1)
        middles = np.stack([np.bincount(owner, own[:, axis], len(centers)) for axis in range(3)], axis=1)
        middles /= shares[:, None]
        for k, center in enumerate(centers):
            if (power < power[k] - 1e-9).all(axis=1).any():  # no point of the solid is in this cell
                continue
            corners = _cell(solid, centers, limits, k, middles[k])
            if len(corners):
                far = np.linalg.norm(corners - center, axis=1)
                reach[k] = max(reach[k], far.max())
                missed.append(corners[far > limits[k]])
    missed = np.concatenate(missed) if missed else np.zeros((0, 3))
    if len(missed):
        return None, missed
    used = reach > 0
    radii = reach[used] + _ROUNDING
    return (centers[used], radii, max(0.0, float((radii - depths[used]).max()))), missed


def _cell(solid: Polytope, centers, radii, k: int, middle) -> np.ndarray:
    """The corners of the part of a solid of which no other ball's power is less than ball k's: [V, 3], perhaps none.

    `middle` is a point that may be well within it."""
    others = np.delete(np.arange(len(centers)), k)
    apart = np.linalg.norm(centers[others] - centers[k], axis=1)
    others, apart = others[apart > 1e-9], apart[apart > 1e-9]
    nearest = np.argsort(apart - radii[others])[:_NEIGHBOURS]
    others, apart = others[nearest], apart[nearest]
    normals = (centers[others] - centers[k]) / apart[:, None]
    power = (centers[others] ** 2).sum(1) - (centers[k] ** 2).sum() - radii[others] ** 2 + radii[k] ** 2
    normals = np.concatenate([solid.normals, normals])
    offsets = np.concatenate([solid.offsets, power / (2 * apart)])
    rooms = [(offsets - normals @ point).min() for point in (centers[k], middle)]
    inside, room = (centers[k], rooms[0]) if rooms[0] >= rooms[1] else (middle, rooms[1])
    if room < 1e-4:
        inside, room = inner_ball(normals, offsets)
    return corners_of(normals, offsets, inside) if room > 1e-7 else np.zeros((0, 3))
