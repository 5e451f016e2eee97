"""Points as three component arrays, so that distances of all pairs are one elementwise pass that XLA fuses.

Every function here has finite first and second derivatives everywhere; what is undefined takes one of its one-sided
values, by `where` with a safe operand inside.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from .._linalg import AT_ZERO

Point = tuple[jax.Array, jax.Array, jax.Array]
Field = Callable[[Point], jax.Array]


def components(x: Any, dtype: Any = None) -> Point:
    """The three components of vectors [..., 3], each [...]."""
    x = jnp.asarray(x, dtype)
    return x[..., 0], x[..., 1], x[..., 2]


def columns(x: jax.Array) -> Point:
    """The three components of vectors [..., 3], each [..., 1], to broadcast against obstacles [O]."""
    return x[..., 0, None], x[..., 1, None], x[..., 2, None]


def difference(a: Point, b: Point) -> Point:
    """`a - b`."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def along(a: Point, t: jax.Array, step: Point) -> Point:
    """`a + t step`."""
    return a[0] + t * step[0], a[1] + t * step[1], a[2] + t * step[2]


def dot(a: Point, b: Point) -> jax.Array:
    """`a . b`."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def magnitude(x: jax.Array) -> jax.Array:
    """`|x|`, with slope 1 at zero."""
    return jnp.where(x >= 0, x, -x)


def larger(a: jax.Array, b: jax.Array) -> jax.Array:
    """`max(a, b)`, with the slope of `a` where they are equal."""
    return jnp.where(a >= b, a, b)


def fraction(numerator: jax.Array, denominator: jax.Array) -> jax.Array:
    """`numerator / denominator` clipped to [0, 1]; zero where the denominator is not positive."""
    positive = denominator > 0
    ratio = jnp.where(positive, numerator / jnp.where(positive, denominator, 1), 0)
    return jnp.where(ratio < 0, 0, jnp.where(ratio > 1, 1, ratio))


def outside_corner(*q: jax.Array) -> jax.Array:
    """Signed distance to the corner of an orthant, `q_i` the signed distance to face i.

    Behind one face only, and inside, it is the largest q; over an edge or a corner the length of the positive ones.
    """
    largest = q[0]
    for x in q[1:]:
        largest = larger(largest, x)
    is_round, square = _over_edge(q)
    return jnp.where(is_round, jnp.sqrt(_away_from_zero(square)), largest)


def corner_derivatives(q: Sequence[jax.Array], rates: Sequence[jax.Array]) -> tuple[list[jax.Array], jax.Array]:
    """First derivatives of `outside_corner` in each q, and its second derivative along `rates`."""
    is_round, square = _over_edge(q)
    inverse = jax.lax.rsqrt(_away_from_zero(square))
    slopes, found = [], jnp.zeros_like(is_round)
    for i, x in enumerate(q):
        is_largest = ~found
        for other in q[i + 1 :]:
            is_largest &= x >= other
        found |= is_largest
        slopes.append(jnp.where(is_round, jnp.where(x > 0, x, 0) * inverse, is_largest.astype(x.dtype)))
    along = sum(s * rate for s, rate in zip(slopes, rates, strict=True))
    moving = sum(jnp.where(x > 0, rate * rate, 0) for x, rate in zip(q, rates, strict=True))
    return slopes, jnp.where(is_round, (moving - along * along) * inverse, 0)


def _away_from_zero(square: jax.Array) -> jax.Array:
    """`square`, and 1 where it is next to zero.

    By its own value, and not by the choice that is made with it: in a compiled program both may be computed twice, and
    rounded differently.
    """
    return jnp.where(square < AT_ZERO, 1.0, square)


def _over_edge(q: Sequence[jax.Array]) -> tuple[jax.Array, jax.Array]:
    """Whether two of q or more are positive, and the sum of the squares of those that are."""
    square = sum((jnp.where(x > 0, x * x, 0) for x in q), jnp.zeros_like(q[0]))
    count = sum(((x > 0).astype(jnp.int32) for x in q), jnp.zeros(q[0].shape, jnp.int32))
    return (count >= 2) & (square >= AT_ZERO), square


def length_derivatives(offset: Sequence[jax.Array], rates: Sequence[jax.Array]) -> tuple[list[jax.Array], jax.Array]:
    """First derivatives of `length` in each component, and its second derivative along `rates`."""
    square = sum(x * x for x in offset)
    touching = square < AT_ZERO
    inverse = jnp.where(touching, 0, jax.lax.rsqrt(jnp.where(touching, 1.0, square)))
    slopes = [x * inverse for x in offset]
    along = sum(s * rate for s, rate in zip(slopes, rates, strict=True))
    return slopes, (sum(rate * rate for rate in rates) - along * along) * inverse


def rotated(T_world_frame: Any, v: Point, back: bool = False) -> Point:
    """World vectors in frames [O, 4, 4]: `R^T v`; with `back`, vectors of the frames in the world: `R v`."""
    T = jnp.asarray(T_world_frame, v[0].dtype)
    x, y, z = (dot(components(T[..., i, :3] if back else T[..., :3, i]), v) for i in range(3))
    return x, y, z


def to_local(T_world_frame: Any, p: Point) -> Point:
    """World points in frames [O, 4, 4]: `R^T (p - t)`."""
    T = jnp.asarray(T_world_frame, p[0].dtype)
    return rotated(T, difference(p, components(T[..., :3, 3])))


def gradient(field: Field, p: Point) -> Point:
    """The gradient of an elementwise field, by forward mode."""

    def partial(i):
        def varied(x):
            return field((*p[:i], x, *p[i + 1 :]))

        return jax.jvp(varied, (p[i],), (jnp.ones_like(p[i]),))[1]

    return partial(0), partial(1), partial(2)


def slope(field: Field, p: Point, v: Point) -> jax.Array:
    """The derivative of an elementwise field along v, which is broadcast to p."""
    return jax.jvp(field, (p,), (_like(v, p),))[1]


def curvature(field: Field, p: Point, u: Point, v: Point) -> jax.Array:
    """The second derivative `u^T H v` of an elementwise field; u and v are broadcast to p."""
    return jax.jvp(lambda p: slope(field, p, u), (p,), (_like(v, p),))[1]


def _like(v: Point, p: Point) -> Point:
    x, y, z = (jnp.broadcast_to(a, b.shape) for a, b in zip(v, p, strict=True))
    return x, y, z
