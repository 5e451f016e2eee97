"""Which part of an object a point belongs to: the nearest, as far as the camera sees it."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..kinematics._motion import BodyMotion, JointAxis, move
from ..kinematics._scalars import add, add3, cross, mul, rotate, sub3
from ..world import Boxes
from ..world._components import Point, corner_derivatives, dot, rotated, to_local
from ..world._obstacles import FAR
from ._object_model import ObjectModel


class Parts(NamedTuple):
    """Where the links of an object are, `motions` by body, and the axes of its joints, `axes`, in its base's frame."""

    motions: dict[int, BodyMotion]
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
    return Parts(*move(model.robot.model, model.links, q))


def slots(model: ObjectModel) -> Iterator[tuple[int, Any]]:
    """All shapes, one by one: the place of its link, and an obstacle of one slot."""
    for k, world in enumerate(model.shapes):
        for kind in world.kinds:
            if kind in world.grids or kind.size == 1:
                yield k, kind
            else:
                for i in range(kind.size):
                    yield k, jax.tree.map(lambda a, i=i: a[i : i + 1], kind)


def to_link(motion: BodyMotion, p: Any) -> Any:
    """Points of the base's frame in a link's."""
    return rotate(_transposed(motion.rotation), sub3(p, motion.position))


def nearest(model: ObjectModel, parts: Parts, p: Point, camera: Any) -> Found:
    """The part nearest to each of N points `p`, three [N], of the base's frame, seen by a camera at `camera` [3] there.

    The distance is the signed one of `jaxrmp.world`, but within a box it is to the nearest face that the camera sees:
    what noise puts behind the middle of a thin panel still belongs to its front.
    """

    def evaluate(shape: Any, local: Point, eye: Any) -> tuple[jax.Array, Point, Point]:
        distance, gradient = _distance(shape, local, eye)
        return distance, gradient, local

    def better(new: jax.Array, old: jax.Array) -> jax.Array:
        return jnp.abs(new) < jnp.abs(old)

    return over_shapes(model, parts, p, camera, evaluate, better, FAR)


def over_shapes(
    model: ObjectModel, parts: Parts, p: Point, camera: Any, evaluate: Callable, better: Callable, start: float
) -> Found:
    """The best of what `evaluate` finds of every shape, a distance, its gradient and where, in the link's frame."""
    zero = jnp.zeros_like(p[0])
    best = Found(zero + start, (zero, zero, zero), p, jnp.zeros(zero.shape, jnp.int32))
    for k, shape in slots(model):
        motion = parts.motions[model.links[k]]
        d, g, x = evaluate(shape, to_link(motion, p), to_link(motion, camera))
        wins = better(d, best.distance) & jnp.reshape(jnp.asarray(shape.active), ())
        g, x = rotate(motion.rotation, g), add3(motion.position, rotate(motion.rotation, x))

        def chosen(new: Any, old: Any, wins: jax.Array = wins) -> Any:
            return jnp.where(wins, new, old)

        gradient, at = tuple(map(chosen, g, best.gradient)), tuple(map(chosen, x, best.at))
        best = Found(chosen(d, best.distance), gradient, at, chosen(k, best.link))  # type: ignore[arg-type]
    return best


def jacobian(model: ObjectModel, parts: Parts, found: Found) -> list[jax.Array]:
    """How the distances change as the object moves and the points stay: 6 + n columns [N].

    By a displacement of the base, m, and a turn about `ObjectModel.middle`, rad, both in the base's frame, and by the
    joints: `-g`, `-(p - middle) x g`, and of a hinge `-axis . ((p - anchor) x g)`, of a slide `-axis . g`.
    """
    g, p = found.gradient, found.at
    middle = [jnp.asarray(model.middle, p[0].dtype)[i] for i in range(3)]
    turn = cross(sub3(p, tuple(middle)), g)  # type: ignore[arg-type]
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


def in_box(shape: Boxes, p: Any) -> tuple[Point, Point]:
    """Points in a box's own frame, three [N], and half its sides."""
    dtype = jnp.result_type(p[0])
    local = to_local(jnp.asarray(shape.T_world_box, dtype)[0], p)
    half = jnp.asarray(shape.half_extents, dtype)[0]
    return local, (half[0], half[1], half[2])


def out_of_box(shape: Boxes, v: Point) -> Point:
    """Vectors of a box's own frame in its link's."""
    return rotated(jnp.asarray(shape.T_world_box, v[0].dtype)[0], v, back=True)


def _distance(shape: Any, p: Point, eye: Any) -> tuple[jax.Array, Point]:
    if isinstance(shape, Boxes):
        return _to_visible_faces(shape, p, eye)
    columns: Any = tuple(x[:, None] for x in p)
    gradient, _ = shape.derivatives(columns, tuple(jnp.zeros_like(x) for x in columns))
    d = shape.distance(columns)
    x, y, z = (jnp.broadcast_to(g, d.shape)[:, 0] for g in gradient)
    return d[:, 0], (x, y, z)


def _to_visible_faces(shape: Boxes, p: Point, eye: Any) -> tuple[jax.Array, Point]:
    local, half = in_box(shape, p)
    seen = visible_sides(half, in_box(shape, tuple(jnp.asarray(x, p[0].dtype) for x in eye))[0])
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
    positive = [jnp.where(f > 0, f, 0) for f in faces]
    outside = jnp.sqrt(jnp.where(inside, 1, dot(*(((positive[0], positive[1], positive[2]),) * 2))))
    d = jnp.where(inside, jnp.maximum(jnp.maximum(faces[0], faces[1]), faces[2]), outside)
    x, y, z = (s * slope for s, slope in zip(signs, slopes, strict=True))
    return d, out_of_box(shape, (x, y, z))


def _transposed(R: Any) -> Any:
    return R[0], R[3], R[6], R[1], R[4], R[7], R[2], R[5], R[8]


def _dot(u: Any, v: Any) -> Any:
    return add(add(mul(u[0], v[0]), mul(u[1], v[1])), mul(u[2], v[2]))
