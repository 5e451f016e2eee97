"""Points as three component arrays, so that distances of all pairs are one elementwise pass that XLA fuses.

Every function here has finite first and second derivatives everywhere; what is undefined takes one of its one-sided
values, by `where` with a safe operand inside.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

Point = tuple[jax.Array, jax.Array, jax.Array]
Field = Callable[[Point], jax.Array]

_TOUCHING = 1e-20  # m^2: below 1e-10 m a length counts as zero, since its second derivative would overflow float32


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


def length(*v: jax.Array) -> jax.Array:
    """`|v|`; below 1e-10 it is zero and so are its derivatives."""
    square = sum(x * x for x in v)
    touching = square < _TOUCHING
    return jnp.where(touching, 0.0, jnp.sqrt(jnp.where(touching, 1.0, square)))


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
    positive = [jnp.where(x > 0, x, 0) for x in q]
    over_edge = sum((x > 0).astype(jnp.int32) for x in q) >= 2
    square = sum(x * x for x in positive)
    round_ = over_edge & (square >= _TOUCHING)
    return jnp.where(round_, jnp.sqrt(jnp.where(round_, square, 1.0)), largest)


def to_local(T_world_frame: Any, p: Point) -> Point:
    """World points in frames [O, 4, 4]: `R^T (p - t)`."""
    T = jnp.asarray(T_world_frame, p[0].dtype)
    offset = difference(p, components(T[..., :3, 3]))
    x, y, z = (dot(components(T[..., :3, i]), offset) for i in range(3))
    return x, y, z


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
