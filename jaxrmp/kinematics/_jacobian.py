"""Jacobians of points of the robot, and of distances between them, from where the joints' axes are."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import matmul
from ..xla import concatenated
from ._motion import JointAxis
from ._robot import KinematicModel
from ._scalars import ZERO, Vector, add3, cross, mul, scale, sub3


def jacobian_rows(
    model: KinematicModel, bodies: Sequence[int], position: Vector, axes: dict[int, JointAxis], dtype: Any
) -> Vector:
    """The transposed rows of the Jacobian of K points at `position` (entries [K]) on `bodies`: three arrays [n, K]."""
    joints = moving(model, axes)
    if not joints:
        still = jnp.zeros((len(model.joint_names), len(bodies)), dtype)
        return still, still, still
    moved = _above(model, joints, bodies, dtype)
    turns, slides = turns_and_slides(model, joints, axes)
    directions, anchors, slides = _entries([turns, [axes[i].anchor for i in joints], slides], dtype)
    directions, slides, anchors = (
        tuple(v if isinstance(v, float) else v[:, None] for v in vector) for vector in (directions, slides, anchors)
    )
    entries = (mul(moved, v) for v in add3(cross(directions, sub3(position, anchors)), slides))
    # A planar arm has a row that is the number zero.
    x, y, z = (by_coordinate(model, joints, jnp.broadcast_to(jnp.asarray(v, dtype), moved.shape)) for v in entries)
    return x, y, z


def line_rows(
    model: KinematicModel,
    ends: tuple[Sequence[int], Sequence[int]],
    direction: Vector,
    moment: Vector,
    axes: dict[int, JointAxis],
    dtype: Any,
) -> jax.Array:
    """The transposed Jacobian [n, P] of P distances, each along a line from a point on one body to one on another.

    **Arguments**: `ends`, the bodies of the first and of the second points; `direction` `u`, unit vectors from the
    second to the first point, and `moment`, `p x u` for a point p of the line, entries [P]. A joint above the first
    body changes the distance by `z . (p x u) + (o x z) . u` if it turns about the axis z through o, by `z . u` if it
    slides; one above the second by minus that; and one above both by nothing, whatever the line is.
    """
    joints = moving(model, axes)
    sign = _above(model, joints, ends[0], dtype) - _above(model, joints, ends[1], dtype)
    lines = jnp.stack([*direction, *moment])
    return by_coordinate(model, joints, sign * matmul(twists(model, joints, axes, ZERO, dtype).T, lines))


def twists(
    model: KinematicModel, joints: list[int], axes: dict[int, JointAxis], point: Vector, dtype: Any
) -> jax.Array:
    """How a body above which `joints` are moves at unit rate of each: velocity of it at `point`, angular velocity.
    [6, joints]."""
    if not joints:
        return jnp.zeros((6, 0), dtype)
    turns, slides = turns_and_slides(model, joints, axes)
    moved = [
        add3(cross(turn, sub3(point, axes[i].anchor)), slide)
        for i, turn, slide in zip(joints, turns, slides, strict=True)
    ]
    entries = [v for vectors in (moved, turns) for column in zip(*vectors, strict=True) for v in column]
    return jnp.stack([jnp.asarray(v, dtype) for v in entries]).reshape(6, len(joints))


def moving(model: KinematicModel, axes: dict[int, JointAxis]) -> list[int]:
    """The joints among `axes` that a coordinate moves."""
    return [i for i in axes if model.joints[i].coordinate >= 0]


def _above(model: KinematicModel, joints: list[int], bodies: Sequence[int], dtype: Any) -> np.ndarray:
    """Which joints move which bodies: ones and zeros [joints, bodies]."""
    above = [{i for b in model.path(body) for i in model.joints_of_body[b]} for body in bodies]
    return np.array([[i in found for found in above] for i in joints], dtype).reshape(len(joints), len(bodies))


def turns_and_slides(
    model: KinematicModel, joints: list[int], axes: dict[int, JointAxis]
) -> tuple[list[Vector], list[Vector]]:
    """Angular velocity, and velocity besides that, that each joint gives at unit rate of its coordinate."""
    along = [scale(model.joints[i].multiplier, axes[i].direction) for i in joints]
    turning = [model.joints[i].kind == "revolute" for i in joints]
    turns = [v if turn else ZERO for v, turn in zip(along, turning, strict=True)]
    return turns, [ZERO if turn else v for v, turn in zip(along, turning, strict=True)]


def by_coordinate(model: KinematicModel, joints: list[int], rows: jax.Array) -> jax.Array:
    """Rows of joints as rows of coordinates: those of one coordinate add up, and one without a joint has zeros."""
    of_coordinate, n = [model.joints[i].coordinate for i in joints], len(model.joint_names)
    if of_coordinate == list(range(n)):
        return rows
    sums = np.array([[c == i for c in of_coordinate] for i in range(n)], rows.dtype).reshape(n, len(joints))
    return matmul(sums, rows)


def _entries(several: list[list[Vector]], dtype: Any) -> list[Vector]:
    """Lists of vectors, each as one vector of arrays; a component that is zero throughout stays a float."""
    columns = [column for vectors in several for column in zip(*vectors, strict=True)]
    zero = [all(isinstance(v, float) and v == 0.0 for v in column) for column in columns]
    others = [[jnp.asarray(v, dtype).reshape(1) for v in c] for c, z in zip(columns, zero, strict=True) if not z]
    found = iter(concatenated(others))
    entries = [0.0 if z else next(found) for z in zero]
    return [(entries[i], entries[i + 1], entries[i + 2]) for i in range(0, len(entries), 3)]


def as_jacobian(transposed: Vector) -> jax.Array:
    """Three transposed rows [n, K] as the Jacobian [K, 3, n]."""
    return jnp.moveaxis(jnp.stack(transposed), -1, 0)


def rows(vector: Vector, shape: tuple[int, ...], dtype: Any) -> jax.Array:
    """Three components of `shape` [K, ...] as one array [K, 3, ...]."""
    return jnp.stack([jnp.broadcast_to(jnp.asarray(v, dtype), shape) for v in vector], axis=1)
