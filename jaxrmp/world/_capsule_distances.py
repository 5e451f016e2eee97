"""The task map from joint positions to the distances between capsules along the robot's links and the obstacles."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from .._errors import ShapeError
from .._linalg import length
from .._pytree import as_floats, pytree, set_field
from .._ranges import Finite, NonNegative
from .._task_map import Pushforward, TaskMap, pushforward
from ._boxes import Boxes
from ._components import Point, along, columns, curvature, difference, dot, gradient, slope
from ._cylinders import Cylinders
from ._obstacle_distances import radii_of_points, rows_of
from ._obstacles import FAR, Obstacles, curved_from
from ._world import World

_RIDGED = (Boxes, Cylinders)  # their signed distances have ridges inside; the other kinds' have none, or single points
_SHARP = 1e-3  # by how much the slope along the axis jumps at what counts as a ridge


@pytree
class CapsuleDistances(TaskMap):
    """Distances of K capsules on the robot to O obstacles: `d = min_t sdf(a + t (b - a)) - r`, t in [0, 1], [K O].

    The nearest t has a closed form for spheres, capsules and half-spaces; for boxes and cylinders, whose signed
    distance is convex, it comes from 24 bisections and a Newton step, for grids from samples and golden section.
    Derivatives go through it: with `u = b - a`, `p = a + t u` and pd at fixed t, `J = g^T J_p` (envelope theorem) and
    `c = pd^T H pd + g . c_p - (u^T H pd + g . ud)^2 / u^T H u`, the last where t is inside and the obstacle is curved
    along u. While the axis itself is inside a box or a cylinder, d is minus the depth of its deepest point, which is
    on a ridge of the signed distance: as near to one side, with normal g_1, as to another, with g_2. There
    `g = l g_1 + (1 - l) g_2` with the l in [0, 1] for which `g . u = 0`, the nearest point slides along the axis by
    `td = (g_1 - g_2) . pd / (g_2 - g_1) . u` to stay on the ridge, and with `w = pd + td u`
    `c = w^T (l H_1 + (1 - l) H_2) w + g . (c_p + 2 td ud)`.

    **Arguments**: `points_a`, `points_b`, maps x [n] -> [K, 3] to the ends of the axes, m; `world`; `radii` [K] or a
    number, m.
    **Raises** `ConfigurationError` for a negative radius, `ShapeError` when called if shapes do not fit.

    >>> from jaxrmp.world import Spheres
    >>> scene = World(spheres=Spheres.of([((0, 0, 2), 0.5)]))
    >>> link = CapsuleDistances(lambda x: x[None], lambda x: x[None] + jnp.array([0, 0, 1.0]), scene, radii=0.25)
    >>> link(jnp.zeros(3)).tolist()
    [0.25]
    """

    points_a: Callable[[jax.Array], jax.Array]
    points_b: Callable[[jax.Array], jax.Array]
    world: World
    radii: NonNegative[Finite[Any]] = 0.0

    def __post_init__(self):
        set_field(self, "radii", as_floats(self.radii))

    def __call__(self, x):
        a, b = self.points_a(x), self.points_b(x)
        radii = self._radii(a, b)
        d = self.world.over_kinds(a, lambda kind: _least_distance(kind, columns(a), columns(b))) - radii[:, None]
        return self.world.mask_inactive(d, FAR).reshape(-1)

    def pushforward(self, x, xd):
        at_a, at_b = pushforward(self.points_a, x, xd), pushforward(self.points_b, x, xd)
        radii = self._radii(at_a.y, at_b.y)
        parts = [_carried(kind, at_a, at_b) for kind in self.world.kinds]
        n, K = at_a.J.shape[-1], at_a.y.shape[0]
        empty = Pushforward(*(jnp.zeros((K, 0, *tail), at_a.y.dtype) for tail in ((), (), (n,), ())))
        d, dd, J, c = (jnp.concatenate(column, axis=1) for column in zip(empty, *parts, strict=True))
        active = self.world.active
        d, dd, c = jnp.where(active, d - radii[:, None], FAR), jnp.where(active, dd, 0), jnp.where(active, c, 0)
        J = jnp.where(active[:, None], J, 0)
        return Pushforward(d.reshape(-1), dd.reshape(-1), J.reshape(-1, n), c.reshape(-1))

    def _radii(self, a, b):
        if a.shape != b.shape:
            raise ShapeError(f"points_a and points_b give shapes {a.shape} and {b.shape}, expected the same [K, 3].")
        return radii_of_points(self.radii, a)


def _least_distance(kind: Obstacles, a, b):
    """`min_t sdf(a + t (b - a))`, with first and second derivatives.

    One Newton step from the nearest t, held fixed, leaves t where it is and gives it its derivative.
    """
    t = jax.lax.stop_gradient(kind.nearest_on_segment(a, b))
    step = difference(b, a)
    bent, bend = _bend_along(kind, a, t, step)
    pull = slope(kind.distance, along(a, t, step), step)
    slid = t - jnp.where(bent, _change(pull) / jax.lax.stop_gradient(bend), 0)
    smooth = kind.distance(along(a, slid, step))
    if not isinstance(kind, _RIDGED):
        return smooth
    ridge = jax.lax.stop_gradient(_ridge_at(kind, a, t, step))
    before, after = _around(along(a, t, step), step)
    t = t - _change(kind.distance(before) - kind.distance(after)) / ridge.jump
    before, after = _around(along(a, t, step), step)
    mixed = ridge.share * kind.distance(before) + (1 - ridge.share) * kind.distance(after)
    return jnp.where(ridge.is_there, jax.lax.stop_gradient(smooth) + _change(mixed), smooth)


def _change(x: jax.Array) -> jax.Array:
    """Zero, with the derivatives of x."""
    return x - jax.lax.stop_gradient(x)


def _bend_along(kind: Obstacles, a, t, step):
    """Where t slides as the segment moves, and there the distance's second derivative along it (elsewhere 1)."""
    bend = curvature(kind.distance, along(a, t, step), step, step)
    bent = (t > 0) & (t < 1) & (bend > curved_from(step))
    return bent, jnp.where(bent, bend, 1)


class _Ridge(NamedTuple):
    """Where the nearest point is on a ridge, the normals on both sides, `share` l of the first, `jump (g_1 - g_2) . u`
    (elsewhere -1)."""

    is_there: jax.Array
    before: Point
    after: Point
    share: jax.Array
    jump: jax.Array


def _ridge_at(kind: Obstacles, a, t, step) -> _Ridge:
    p = along(a, t, step)
    before, after = (gradient(kind.distance, beside) for beside in _around(p, step))
    falls, rises = dot(before, step), dot(after, step)
    inside = (t > 0) & (t < 1) & (kind.distance(p) < 0)
    sharp = rises - falls > _SHARP * length(*step)
    is_there = inside & sharp & (falls <= 0) & (rises >= 0)
    jump = jnp.where(is_there, falls - rises, -1)
    return _Ridge(is_there, before, after, jnp.where(is_there, -rises / jump, 0), jump)


def _around(p: Point, step: Point) -> tuple[Point, Point]:
    """The points a little before and after p along the axis, by more than the error of t, moving as p does."""
    gap = max(1e-6, 1e3 * float(jnp.finfo(p[0].dtype).eps))
    step = jax.lax.stop_gradient(step)
    return along(p, jnp.asarray(-gap, p[0].dtype), step), along(p, jnp.asarray(gap, p[0].dtype), step)


def _carried(kind: Obstacles, at_a: Pushforward, at_b: Pushforward) -> Pushforward:
    a, b = columns(at_a.y), columns(at_b.y)
    t = kind.nearest_on_segment(a, b)
    step, step_rate = difference(b, a), difference(columns(at_b.yd), columns(at_a.yd))
    p = along(a, t, step)
    v = along(columns(at_a.yd), t, step_rate)
    pull = along(columns(at_a.c), t, difference(columns(at_b.c), columns(at_a.c)))
    g = gradient(kind.distance, p)
    bent, bend = _bend_along(kind, a, t, step)
    slide = curvature(kind.distance, p, step, v) + dot(g, step_rate)
    c = curvature(kind.distance, p, v, v) + dot(g, pull) - jnp.where(bent, slide * slide / bend, 0)
    if isinstance(kind, _RIDGED):
        ridge = _ridge_at(kind, a, t, step)
        mixed = along(ridge.after, ridge.share, difference(ridge.before, ridge.after))
        rate = -dot(difference(ridge.before, ridge.after), v) / ridge.jump
        w = along(v, rate, step)
        before, after = (curvature(kind.distance, beside, w, w) for beside in _around(p, step))
        c_mixed = ridge.share * before + (1 - ridge.share) * after + dot(mixed, along(pull, 2 * rate, step_rate))
        x, y, z = (jnp.where(ridge.is_there, m, plain) for m, plain in zip(mixed, g, strict=True))
        g, c = (x, y, z), jnp.where(ridge.is_there, c_mixed, c)
    of_a, of_b = rows_of(at_a.J), rows_of(at_b.J)
    J = dot(tuple(x[..., None] for x in g), along(of_a, t[..., None], difference(of_b, of_a)))
    return Pushforward(kind.distance(p), dot(g, v), J, c)
