"""What all kinds of obstacles share: slots, an activity mask, padding, and the point of a segment nearest to them."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, ShapeError
from .._pytree import set_field
from ._components import Point, along, curvature, difference, dot, gradient, slope

FAR = 1e3
"""The distance, m, that an inactive obstacle reports, with zero derivatives."""

_BISECTIONS = 24


class Obstacles:
    """Obstacles of one kind in a fixed number of slots.

    `active` [n] says which slots hold an obstacle. Values may change without recompilation, the number of slots not.
    """

    active: Any

    @property
    def size(self) -> int:
        """Number of slots."""
        return jnp.shape(self.active)[-1]

    def distance(self, p: Point) -> jax.Array:
        """Signed distance of points `p`, m, as if all slots were active: from components [..., 1 or n] to [..., n]."""
        raise NotImplementedError

    def derivatives(self, p: Point, v: Point) -> tuple[Point, jax.Array]:
        """Gradient of the distance at `p`, and its second derivative along `v`: `grad d` and `v^T H v`.

        By autodiff; where a closed form is as short as the distance itself, a kind gives it.
        """
        return gradient(self.distance, p), curvature(self.distance, p, v, v)

    def nearest_on_segment(self, a: Point, b: Point) -> jax.Array:
        """The t in [0, 1] at which `distance(a + t (b - a))` is least, from `a` to `b`, for a convex obstacle.

        Bisection of the slope, which rises with t, and one Newton step inside the last bracket.
        """
        step = difference(b, a)
        slots = jnp.zeros((self.size,), a[0].dtype)
        zero = slots + 0 * a[0]

        def halve(_, bracket):
            low, high = bracket
            middle = 0.5 * (low + high)
            rising = slope(self.distance, along(a, middle, step), step) > 0
            return jnp.where(rising, low, middle), jnp.where(rising, middle, high)

        low, high = jax.lax.fori_loop(0, _BISECTIONS, halve, (zero, zero + 1))
        middle = 0.5 * (low + high)
        p = along(a, middle, step)
        bend = curvature(self.distance, p, step, step)
        bent = bend > curved_from(step)
        newton = middle - slope(self.distance, p, step) / jnp.where(bent, bend, 1)
        inner = jnp.where(bent, jnp.clip(newton, low, high), middle)
        rising, falling = slope(self.distance, a, step) >= 0, slope(self.distance, b, step) <= 0
        return jnp.where(rising, 0, jnp.where(falling, 1, inner))


class PaddedObstacles(Obstacles):
    """Obstacles of one kind whose fields all have a leading axis of slots."""

    def set(self, index: int, **fields: Any) -> Self:
        """The same obstacles with slot `index` given new `fields`; it becomes active unless `active=False` is given.

        **Raises** `ConfigurationError` for an index beyond the slots or a field that this kind does not have.
        """
        if isinstance(index, int) and not -self.size <= index < self.size:
            raise ConfigurationError(
                f"index {index} is beyond the {self.size} slots of {type(self).__name__}: give more capacity to of()."
            )
        known = {f.name for f in dataclasses.fields(self) if not f.metadata.get("static")}  # type: ignore[arg-type]
        if unknown := set(fields) - known:
            raise ConfigurationError(f"{type(self).__name__} has no field {sorted(unknown)}. It has {sorted(known)}.")
        changed = {"active": True, **fields}
        arrays = {name: jnp.asarray(getattr(self, name)).at[index].set(v) for name, v in changed.items()}
        return dataclasses.replace(self, **arrays)  # type: ignore[type-var]


def curved_from(step: Point) -> jax.Array:
    """The second derivative along `step` above which an obstacle counts as curved, and not flat, along it."""
    return jnp.finfo(step[0].dtype).eps ** 0.5 * dot(step, step)


def padded(
    kind: str, rows: Iterable[Sequence], capacity: int | None, neutral: Sequence
) -> tuple[list[Any], np.ndarray]:
    """Columns of the obstacles given row by row, padded to `capacity` with `neutral`, and the activity mask."""
    rows = [tuple(row) for row in rows]
    capacity = len(rows) if capacity is None else capacity
    if len(rows) > capacity:
        raise ConfigurationError(
            f"{len(rows)} obstacles do not fit into capacity={capacity} of {kind}: give a capacity of at least "
            f"{len(rows)}."
        )
    for i, row in enumerate(rows):
        if len(row) != len(neutral):
            raise ConfigurationError(f"obstacle {i} of {kind} has {len(row)} entries, expected {len(neutral)}.")
    filled = [*rows, *[tuple(neutral)] * (capacity - len(rows))]
    columns = []
    for j, blank in enumerate(neutral):
        column = [row[j] for row in filled]
        if any(isinstance(v, jax.Array) for v in jax.tree.leaves(column)):
            columns.append(jnp.stack([jnp.asarray(v, dtype=jnp.result_type(float)) for v in column]))
        elif column:
            columns.append(np.stack([np.asarray(v, dtype=float) for v in column]))
        else:
            columns.append(np.zeros((0, *np.shape(blank))))
    return columns, np.arange(capacity) < len(rows)


def set_fields(obstacles: PaddedObstacles, **shapes: tuple[int, ...]) -> None:
    """Make arrays of an obstacle kind's fields and check that each has one row of its shape per slot."""
    kind = type(obstacles).__name__
    values = {name: _array(getattr(obstacles, name)) for name in shapes}
    first, *_ = shapes
    slots = values[first].shape[:1]
    for name, shape in shapes.items():
        if values[name].shape != (*slots, *shape) or not slots:
            row = "".join(f", {s}" for s in shape)
            raise ShapeError(
                f"{name} of {kind} has shape {values[name].shape}, expected ({slots[0] if slots else 'n'}{row}): "
                "one row per obstacle."
            )
        set_field(obstacles, name, values[name])
    active = np.ones(slots, bool) if obstacles.active is None else obstacles.active
    active = active if isinstance(active, jax.Array) else np.asarray(active)
    if active.shape != slots or active.dtype != bool:
        raise ShapeError(
            f"active of {kind} has shape {active.shape} and type {active.dtype}, expected {slots} of bool: one per "
            "obstacle."
        )
    set_field(obstacles, "active", active)


def _array(value: Any) -> Any:
    return value if isinstance(value, jax.Array) else np.asarray(value, dtype=float)
