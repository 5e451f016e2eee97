"""Which part of an object a point belongs to: the nearest, as far as the camera sees it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import matmul
from ..kinematics._motion import JointAxis, move
from ..kinematics._scalars import add, cross, mul, sub3
from ..world import Boxes, SignedDistanceGrid
from ..world._components import Point, components, corner_derivatives, outside_corner, rotated, to_local
from ..world._obstacles import FAR, with_fields
from ._grids import distance_and_slope
from ._object_model import ObjectModel

_POSES, _PLACES = ("T_world_box", "T_world_cylinder", "T_world_grid"), ("start", "end", "center")


class Parts(NamedTuple):
    """Where the parts of an object are, in its base's frame: its shapes, kind by kind, grids of one size stacked, with
    the place in `ObjectModel.links` of the link of each; and the axes of its joints."""

    kinds: list[tuple[Any, np.ndarray]]
    axes: dict[int, JointAxis]


class Found(NamedTuple):
    """For each of N points the part that it belongs to.

    `distance` [N], m; `gradient`, three [N]; `at`, the points, three [N], both in the base's frame; `link` [N], the
    part's link, as a place in `ObjectModel.links`.
    """

    distance: jax.Array
    gradient: Point
    at: Point
    link: jax.Array


def parts_at(model: ObjectModel, q: jax.Array) -> Parts:
    """Where the parts are with the joints at `q` [n]."""
    motions, axes = move(model.robot.model, model.links, q)
    placed: dict[Any, list[tuple[int, Any]]] = {}
    for k, (link, world) in enumerate(zip(model.links, model.shapes, strict=True)):
        motion = motions[link]
        R = jnp.stack([jnp.asarray(r, q.dtype) for r in motion.rotation]).reshape(3, 3)
        t = jnp.stack([jnp.asarray(x, q.dtype) for x in motion.position])
        for kind in world.kinds:
            alike = (type(kind), kind.values.shape, kind.smooth) if isinstance(kind, SignedDistanceGrid) else type(kind)
            placed.setdefault(alike, []).append((k, _moved(kind, R, t)))
    kinds = []
    for found in placed.values():
        links = np.concatenate([np.full(kind.size, k, np.int32) for k, kind in found])
        alike = [kind for _, kind in found]
        join = jnp.stack if isinstance(alike[0], SignedDistanceGrid) else jnp.concatenate
        kinds.append((alike[0] if len(alike) == 1 else jax.tree.map(lambda *a, join=join: join(a), *alike), links))
    return Parts(kinds, axes)


def _moved(kind: Any, R: jax.Array, t: jax.Array) -> Any:
    """Obstacles of one kind, moved by a rotation and a translation."""
    fields = {}
    for name in _POSES:
        if hasattr(kind, name):
            T = jnp.asarray(getattr(kind, name), t.dtype)
            moved = T.at[..., :3, :3].set(matmul(R, T[..., :3, :3]))
            fields[name] = moved.at[..., :3, 3].set(matmul(T[..., :3, 3], R.T) + t)
    for name in _PLACES:
        if hasattr(kind, name):
            fields[name] = matmul(jnp.asarray(getattr(kind, name), t.dtype), R.T) + t
    if hasattr(kind, "normal"):
        normal = matmul(jnp.asarray(kind.normal, t.dtype), R.T)
        fields.update(normal=normal, offset=jnp.asarray(kind.offset, t.dtype) + matmul(normal, t))
    return with_fields(kind, **fields)


def nearest(model: ObjectModel, parts: Parts, p: Point, camera: Point) -> Found:
    """The part nearest to each of N points `p`, three [N], of the base's frame, seen by a camera at `camera`, there.

    The distance is the signed one of `jaxrmp.world`, but within a box it is to the nearest face that the camera sees:
    what noise puts behind the middle of a thin panel still belongs to its front.
    """

    def evaluate(shape: Any) -> tuple[jax.Array, Point, Point]:
        return *_distance(shape, p, camera), p

    def better(new: jax.Array, old: jax.Array) -> jax.Array:
        return jnp.abs(new) < jnp.abs(old)

    return over_shapes(parts, p, evaluate, better, FAR)


def over_shapes(parts: Parts, p: Point, evaluate: Callable, better: Callable, start: float) -> Found:
    """The best of what `evaluate` finds of every shape: a distance, its gradient and where it holds.

    One after the other in a loop: as one expression, XLA:CPU would compute each anew for every one behind it.
    """
    zero = jnp.zeros_like(p[0])
    best = Found(zero + start, (zero, zero, zero), p, jnp.zeros(zero.shape, jnp.int32))

    def compare(best: Found, one: Any) -> tuple[Found, None]:
        shape, link = one
        d, gradient, at = evaluate(shape)
        wins = better(d, best.distance) & jnp.reshape(shape.active, ())
        new = Found(d, gradient, at, jnp.full(d.shape, link))
        return jax.tree.map(lambda a, b: jnp.where(wins, a, b), new, best), None

    for kind, links in parts.kinds:
        if len(links) == 1:
            best, _ = compare(best, (kind, links[0]))
        else:
            grids = isinstance(kind, SignedDistanceGrid)  # of which each is one slot, without an axis for it
            one_by_one = kind if grids else jax.tree.map(lambda a: jnp.asarray(a)[:, None], kind)
            best, _ = jax.lax.scan(compare, best, (one_by_one, jnp.asarray(links)))
    return best


def jacobian(model: ObjectModel, parts: Parts, found: Found) -> list[jax.Array]:
    """How the distances change as the object moves and the points stay: 6 + n columns [N].

    By a displacement of the base, m, and a turn about `ObjectModel.middle`, rad, both in the base's frame, and by the
    joints: `-g`, `-(p - middle) x g`, and of a hinge `-axis . ((p - anchor) x g)`, of a slide `-axis . g`.
    """
    g, p = found.gradient, found.at
    turn = cross(sub3(p, components(model.middle, p[0].dtype)), g)
    columns: list[Any] = [-x for x in (*g, *turn)]
    kinematic = model.robot.model
    for coordinate in range(model.num_joints):
        total: Any = 0.0
        for i, joint in enumerate(kinematic.joints):
            if joint.coordinate != coordinate:
                continue
            moved = [k for k, b in enumerate(model.links) if i in kinematic.joints_above(b)]
            if not moved:
                continue
            direction, anchor = parts.axes[i]
            arm = cross(sub3(p, anchor), g) if joint.kind == "revolute" else g
            rate = _dot(direction, arm)
            of = jnp.isin(found.link, jnp.asarray(moved)) if len(moved) > 1 else found.link == moved[0]
            total = add(total, jnp.where(of, -mul(joint.multiplier, rate), 0))
        columns.append(jnp.zeros_like(p[0]) + total)
    return columns


def visible_sides(half: Point, eye: Point) -> list[tuple[jax.Array, jax.Array]]:
    """Of a box's faces across each axis, whether a camera at `eye` sees one, and on which side it is, 1 or -1."""
    return [(jnp.abs(e) > h, jnp.where(e >= 0, 1, -1).astype(e.dtype)) for h, e in zip(half, eye, strict=True)]


def in_box(shape: Boxes, p: Point) -> tuple[Point, Point]:
    """Points in a box's own frame, three [N], and half its sides."""
    dtype = p[0].dtype
    return to_local(jnp.asarray(shape.T_world_box, dtype)[0], p), components(shape.half_extents, dtype)


def out_of_box(shape: Boxes, v: Point) -> Point:
    """Vectors of a box's own frame in the base's."""
    return rotated(jnp.asarray(shape.T_world_box, v[0].dtype)[0], v, back=True)


def _distance(shape: Any, p: Point, eye: Point) -> tuple[jax.Array, Point]:
    if isinstance(shape, Boxes):
        return _to_visible_faces(shape, p, eye)
    if isinstance(shape, SignedDistanceGrid) and not shape.smooth:
        return distance_and_slope(shape, p)
    columns: Any = tuple(x[:, None] for x in p)
    gradient, _ = shape.derivatives(columns, tuple(jnp.zeros_like(x) for x in columns))
    d = shape.distance(columns)
    x, y, z = (jnp.broadcast_to(g, d.shape)[:, 0] for g in gradient)
    return d[:, 0], (x, y, z)


def _to_visible_faces(shape: Boxes, p: Point, eye: Point) -> tuple[jax.Array, Point]:
    local, half = in_box(shape, p)
    seen = visible_sides(half, in_box(shape, eye)[0])
    signs = [jnp.where(x >= 0, 1, -1).astype(x.dtype) for x in local]
    faces = [s * x - h for s, x, h in zip(signs, local, half, strict=True)]
    inside = (faces[0] <= 0) & (faces[1] <= 0) & (faces[2] <= 0)
    any_seen = seen[0][0] | seen[1][0] | seen[2][0]
    use = inside & any_seen
    signs = [jnp.where(use, side, s) for s, (_, side) in zip(signs, seen, strict=True)]
    faces = [
        jnp.where(use, jnp.where(visible, side * x - h, -FAR), face)
        for face, x, h, (visible, side) in zip(faces, local, half, seen, strict=True)
    ]
    slopes, _ = corner_derivatives(faces, [jnp.zeros_like(x) for x in local])
    x, y, z = (s * slope for s, slope in zip(signs, slopes, strict=True))
    return outside_corner(*faces), out_of_box(shape, (x, y, z))


def _dot(u: Any, v: Any) -> Any:
    return add(add(mul(u[0], v[0]), mul(u[1], v[1])), mul(u[2], v[2]))
