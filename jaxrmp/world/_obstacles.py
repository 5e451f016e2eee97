"""What all kinds of obstacles share: slots, an activity mask, padding, and the point of a segment nearest to them."""

import dataclasses
import operator
import warnings
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, ClassVar, Self, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import ConfigurationError, ShapeError
from .._pytree import as_floats, set_field
from .._ranges import Range, ranges_of
from .._task_map import check_rigid
from ._components import Point, along, curvature, difference, dot, gradient, slope

FAR = 1e3
"""The distance, m, that an inactive obstacle reports, with zero derivatives."""

LARGEST = 1e9
"""What the sizes of a row's numbers may add up to, m: beyond, and where one is not finite, the row is ignored. Squares
of such lengths are numbers in single precision still."""

_BISECTIONS = 24
_SIZE = Range(lambda value: ~(value < 0) | np.isinf(value), "a number that is not negative")
T = TypeVar("T")
Size = Annotated[T, _SIZE]
"""A radius or the like: not negative, checked where there are numbers; a row with one that is negative is ignored."""


class Obstacles:
    """Obstacles of one kind in a fixed number of slots.

    `active` [n] says which slots hold an obstacle. Values may change without recompilation, the number of slots not.
    What is not finite, as depth cameras mark pixels without depth, is ignored: see `World.ignored`.
    """

    active: Any

    @property
    def size(self) -> int:
        """Number of slots."""
        return jnp.shape(self.active)[-1]

    def usable(self) -> tuple[Self, jax.Array | np.ndarray]:
        """The same obstacles with what is not finite made inactive, and its values harmless; and how much that is."""
        raise NotImplementedError

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
    """Obstacles of one kind whose fields all have a leading axis of slots.

    A kind says what fills a slot that holds nothing, `_blank`, field by field but for `active`, the last: so their
    shapes are known. Fields [4, 4] are poses.
    **Raises** `ShapeError` for other shapes, `RigidTransformError` for a pose that is not rigid.
    """

    _blank: ClassVar[tuple[Any, ...]] = ()

    def __post_init__(self):
        kind, names = type(self).__name__, [f.name for f in dataclasses.fields(self)]  # type: ignore[arg-type]
        slots = np.shape(getattr(self, names[0]))[:1]
        for name, blank in zip(names, self._blank, strict=False):
            value, shape = as_floats(getattr(self, name)), np.shape(blank)
            if value.shape != (*slots, *shape) or not slots:
                row = "".join(f", {s}" for s in shape)
                raise ShapeError(
                    f"{name} of {kind} has shape {value.shape}, expected ({slots[0] if slots else 'n'}{row}): one row "
                    "per obstacle."
                )
            if shape == (4, 4) and not isinstance(value, Tracer):
                used = np.asarray(value)[np.abs(value).sum((1, 2)) <= LARGEST]
                if len(used):
                    check_rigid(used, name)
            set_field(self, name, value)
        active = np.ones(slots, bool) if self.active is None else self.active
        active = active if isinstance(active, jax.Array) else np.asarray(active)
        if active.shape != slots or active.dtype != bool:
            raise ShapeError(
                f"active of {kind} has shape {active.shape} and type {active.dtype}, expected {slots} of bool: one per "
                "obstacle."
            )
        set_field(self, "active", active)
        ignored = self.usable()[1]
        if not isinstance(ignored, Tracer) and ignored:
            warn_of_ignored(f"rows of {kind}")

    def usable(self):
        names = [f.name for f in dataclasses.fields(self)][: len(self._blank)]  # type: ignore[arg-type]
        fields: list[Any] = [getattr(self, name) for name in names]
        xp: Any = jnp if any(isinstance(a, Tracer) for a in (*fields, self.active)) else np
        fields = [xp.asarray(field) for field in fields]

        def total(field):
            return xp.sum(field, axis=tuple(range(1, field.ndim)))

        sizes = {name for name, allowed in ranges_of(type(self)) if allowed is _SIZE}
        # Sums and comparisons alone: whatever is NaN or infinite, its sum is not below the bound.
        with np.errstate(invalid="ignore", over="ignore"):
            good: Any = sum(total(abs(field)) for field in fields) <= LARGEST
            for name, field in zip(names, fields, strict=True):
                if name in sizes:
                    good = good & (total(abs(field) - field) <= 0)
        ignored = xp.sum(self.active & ~good)
        if xp is np and good.all():  # inactive rows, too: what is masked still has gradients, which NaN would spoil
            return self, ignored
        clean = {
            name: xp.where(good.reshape(-1, *(1,) * (field.ndim - 1)), field, xp.asarray(blank, field.dtype))
            for name, field, blank in zip(names, fields, self._blank, strict=True)
        }
        return with_fields(self, active=self.active & good, **clean), ignored

    @classmethod
    def of(cls, rows: Iterable[Sequence] = (), capacity: int | None = None) -> Self:
        """Obstacles from `rows`, each a tuple of the fields but `active` of one, padded to `capacity` slots.

        **Raises** `ConfigurationError` for more rows than that, or a row with more or fewer entries.
        """
        kind, rows = cls.__name__, [tuple(row) for row in rows]
        capacity = len(rows) if capacity is None else capacity
        if len(rows) > capacity:
            raise ConfigurationError(
                f"{len(rows)} obstacles do not fit into capacity={capacity} of {kind}: give a capacity of at least "
                f"{len(rows)}."
            )
        for i, row in enumerate(rows):
            if len(row) != len(cls._blank):
                raise ConfigurationError(f"obstacle {i} of {kind} has {len(row)} entries, expected {len(cls._blank)}.")
        filled = [*rows, *[cls._blank] * (capacity - len(rows))]
        columns = []
        for j, blank in enumerate(cls._blank):
            column = [row[j] for row in filled]
            if any(isinstance(v, jax.Array) for v in jax.tree.leaves(column)):
                columns.append(jnp.stack([jnp.asarray(v, dtype=jnp.result_type(float)) for v in column]))
            else:
                columns.append(np.array([np.asarray(v, float) for v in column]).reshape(-1, *np.shape(blank)))
        return cls(*columns, np.arange(capacity) < len(rows))  # pyright: ignore[reportCallIssue]

    def set(self, index: int | jax.Array, **fields: Any) -> Self:
        """The same obstacles with slot `index` given new `fields`; it becomes active unless `active=False` is given.

        `index` is an integer of any kind, Python's, NumPy's or an array's, from 0 on. Inside a compiled function it
        cannot be checked: there nothing changes where it is negative or beyond the slots.
        **Raises** `ConfigurationError` for an index that is no integer, negative or beyond the slots, and for a field
        that this kind does not have.
        """
        index = _slot(index, self.size, type(self).__name__)
        known = {f.name for f in dataclasses.fields(self) if not f.metadata.get("static")}  # type: ignore[arg-type]
        if unknown := set(fields) - known:
            raise ConfigurationError(f"{type(self).__name__} has no field {sorted(unknown)}. It has {sorted(known)}.")
        changed = {"active": True, **fields}
        arrays = {name: jnp.asarray(getattr(self, name)).at[index].set(v, mode="drop") for name, v in changed.items()}
        return dataclasses.replace(self, **arrays)  # type: ignore[type-var]


def warn_of_ignored(what: str) -> None:
    """Say that numbers that are not finite are ignored; in the same words each time, so that Python says it once."""
    warnings.warn(
        f"some {what} are not finite, or their sizes negative or beyond {LARGEST:.0e} m: they are ignored. "
        "World.ignored tells how many.",
        stacklevel=6,
    )


def with_fields(value: Any, **fields: Any) -> Any:
    """`value` with other fields, whose checks it has passed."""
    changed = object.__new__(type(value))
    changed.__dict__.update({f.name: getattr(value, f.name) for f in dataclasses.fields(value)} | fields)
    return changed


def _slot(index: Any, size: int, kind: str) -> Any:
    """An index into `size` slots, checked; of a placeholder, the type alone, and what is negative is beyond all."""
    if np.shape(index) != () or not np.issubdtype(getattr(index, "dtype", type(index)), np.integer):
        raise ConfigurationError(
            f"index {index!r} is no integer: give the number of one of the {size} slots of {kind}."
        )
    if isinstance(index, Tracer):
        number = jnp.asarray(index, int)
        return jnp.where(number < 0, size, number)
    if not 0 <= (number := operator.index(index)) < size:
        raise ConfigurationError(
            f"index {number} is beyond the {size} slots of {kind}, 0 to {size - 1}: give more capacity to of()."
        )
    return number


def curved_from(step: Point) -> jax.Array:
    """The second derivative along `step` above which an obstacle counts as curved, and not flat, along it."""
    return jnp.finfo(step[0].dtype).eps ** 0.5 * dot(step, step)
