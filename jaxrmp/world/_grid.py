"""A signed distance field sampled on a grid."""

from typing import Annotated, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import ShapeError
from .._linalg import length
from .._pytree import as_floats, pytree, set_field, static
from .._ranges import Range
from .._task_map import check_rigid
from ._components import along, difference, to_local
from ._obstacles import FAR, LARGEST, Obstacles, warn_of_ignored, with_fields

_SAMPLES = 17
_GOLDEN = (5**0.5 - 1) / 2
_NARROWINGS = 40


@pytree
class SignedDistanceGrid(Obstacles):
    """One obstacle of any shape, given by its signed distances at the points of a regular grid.

    Between the points the distance is interpolated: `smooth=True`, by cubics (Catmull-Rom) along each axis, through
    the samples, with a continuous gradient and third-order accurate; `smooth=False`, linearly, cheaper, with a gradient
    that jumps from cell to cell. Outside the grid it is the value at the nearest border point plus the distance to
    that point, which is never less than the true distance: leave a margin of free space around the shape.

    A capsule meets it at the least of 17 samples along its axis, narrowed down between that sample's neighbours. What
    comes closer than that between two other samples is missed, by no more than a 32nd of the axis's length, since a
    distance changes no faster than one goes: next to thin shapes, use short capsules, or spheres.

    **Arguments**: `values` [nx, ny, nz], m, negative inside; at least 2 a side; `origin` [3], where `values[0, 0, 0]`
    is, m; `spacing`, between samples, m; `T_world_grid` [4, 4], the pose of the frame in which the origin is given;
    `active`, a bool; `smooth`.
    Values that are not finite are places of which nothing is known: a point whose distance would be made of one is 1e3
    from the grid, without slope. A grid whose origin, spacing or pose is not finite is inactive.
    **Raises** `ShapeError` for wrong shapes, `ConfigurationError` for a spacing that is not positive,
    `RigidTransformError` for a pose that is not rigid.

    >>> from jaxrmp.world import World
    >>> wall = SignedDistanceGrid(np.broadcast_to([-1.0, 0.0, 1.0], (3, 3, 3)), smooth=False)
    >>> World(grids=(wall,)).signed_distance(jnp.array([1.0, 1.0, 1.5])).tolist()
    [0.5]
    """

    values: Any
    origin: Any = (0.0, 0.0, 0.0)
    spacing: Annotated[Any, Range(lambda value: ~(value <= 0), "a positive number")] = 1.0
    T_world_grid: Any = None
    active: Any = True
    smooth: bool = static(default=True)

    def __post_init__(self):
        T = np.eye(4) if self.T_world_grid is None else self.T_world_grid
        for name, value in (("values", self.values), ("origin", self.origin), ("spacing", self.spacing)):
            set_field(self, name, as_floats(value))
        if self.values.ndim != 3 or min(self.values.shape) < 2:
            raise ShapeError(f"values has shape {self.values.shape}, expected [nx, ny, nz] with at least 2 a side.")
        if self.origin.shape != (3,) or self.spacing.shape != () or jnp.shape(self.active) != ():
            raise ShapeError(
                f"origin, spacing and active have shapes {self.origin.shape}, {self.spacing.shape} and "
                f"{jnp.shape(self.active)}, expected (3,), () and ()."
            )
        known = not isinstance(T, Tracer) and np.isfinite(T).all()
        if np.shape(T) != (4, 4) or (known and check_rigid(T, "T_world_grid").ndim != 2):
            raise ShapeError(f"T_world_grid has shape {np.shape(T)}, expected (4, 4).")
        set_field(self, "T_world_grid", as_floats(T))
        set_field(self, "active", self.active if isinstance(self.active, jax.Array) else np.asarray(self.active, bool))
        ignored = self.usable()[1]
        if not isinstance(ignored, Tracer) and ignored:
            warn_of_ignored("numbers of a SignedDistanceGrid")

    def usable(self):
        xp: Any = jnp if any(isinstance(a, Tracer) for a in jax.tree.leaves(self)) else np
        values, origin, spacing, T = map(xp.asarray, (self.values, self.origin, self.spacing, self.T_world_grid))
        good = (xp.sum(abs(origin)) + xp.sum(abs(T)) + abs(spacing) <= LARGEST) & (spacing > 0)
        holes = xp.sum(~(abs(values) <= LARGEST))
        ignored = self.active * xp.where(good, holes, 1)
        if xp is np and good:
            return self, ignored
        clean = {"origin": (origin, 0), "spacing": (spacing, 1), "T_world_grid": (T, np.eye(4))}
        kept = {name: xp.where(good, a, xp.asarray(blank, a.dtype)) for name, (a, blank) in clean.items()}
        return with_fields(self, active=self.active & good, **kept), ignored

    @property
    def size(self) -> int:
        """One slot."""
        return 1

    def distance(self, p):
        dtype = p[0].dtype
        origin, spacing = jnp.asarray(self.origin, dtype), jnp.asarray(self.spacing, dtype)
        local = to_local(self.T_world_grid, p)
        cells = [(x - o) / spacing for x, o in zip(local, origin, strict=True)]
        last = [n - 1 for n in self.values.shape]
        inside = [jnp.where(u < 0, 0, jnp.where(u > n, n, u)) for u, n in zip(cells, last, strict=True)]
        beyond = length(*(spacing * (u - v) for u, v in zip(cells, inside, strict=True)))
        # By a weighted sum over the samples around, gathered at once.
        values = jnp.asarray(self.values, dtype)
        (i, wi), (j, wj), (k, wk) = (self._taps(u, n) for u, n in zip(inside, values.shape, strict=True))
        around = values[i[..., :, None, None], j[..., None, :, None], k[..., None, None, :]]
        known = abs(around) <= LARGEST
        around = jnp.where(known, around, 0)
        plane = jnp.sum(around * wk[..., None, None, :], axis=-1)
        d = jnp.sum(jnp.sum(plane * wj[..., None, :], axis=-1) * wi, axis=-1).astype(dtype) + beyond
        return jnp.where(known.all((-3, -2, -1)), d, FAR)

    def nearest_on_segment(self, a, b):
        """The field need not be convex: the least of 17 samples, narrowed down by golden section."""
        step = difference(b, a)

        def field(t):
            return self.distance(along(a, t, step))

        samples = np.linspace(0, 1, _SAMPLES)
        best = jnp.argmin(jnp.stack([field(jnp.full_like(a[0], t)) for t in samples]), axis=0)
        middle = jnp.asarray(samples, a[0].dtype)[best]
        low, high = jnp.clip(middle - 1 / (_SAMPLES - 1), 0, 1), jnp.clip(middle + 1 / (_SAMPLES - 1), 0, 1)

        def narrow(_, bracket):
            low, high = bracket
            left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
            keep_left = field(left) < field(right)
            return jnp.where(keep_left, low, left), jnp.where(keep_left, right, high)

        low, high = jax.lax.fori_loop(0, _NARROWINGS, narrow, (low, high))
        inner = 0.5 * (low + high)
        ends = jnp.stack([field(jnp.zeros_like(inner)), field(jnp.ones_like(inner)), field(inner)])
        return jnp.where(ends[2] <= jnp.minimum(ends[0], ends[1]), inner, jnp.where(ends[1] < ends[0], 1, 0))

    def _taps(self, u, n):
        """Indices [..., taps] of the samples around fractional index u of an axis of n samples, and their weights."""
        index = jax.lax.stop_gradient(jnp.clip(jnp.floor(u), 0, n - 2))
        s, i = u - index, index.astype(jnp.int32)
        if not self.smooth:
            return jnp.stack([i, i + 1], axis=-1), jnp.stack([1 - s, s], axis=-1)
        before, after = 0.5 * s * (s * (2 - s) - 1), 0.5 * s * s * (s - 1)
        here, there = 0.5 * (s * s * (3 * s - 5) + 2), 0.5 * s * (s * (4 - 3 * s) + 1)
        # Beyond the border the samples go on in a straight line: 2 f0 - f1 before the first, and so at the last.
        first, last = i == 0, i == n - 2
        here, there = here + jnp.where(first, 2 * before, 0), there - jnp.where(first, before, 0)
        there, here = there + jnp.where(last, 2 * after, 0), here - jnp.where(last, after, 0)
        before, after = jnp.where(first, 0, before), jnp.where(last, 0, after)
        taps = [jnp.maximum(i - 1, 0), i, i + 1, jnp.minimum(i + 2, n - 1)]
        return jnp.stack(taps, axis=-1), jnp.stack([before, here, there, after], axis=-1)
