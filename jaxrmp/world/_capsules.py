"""Capsules."""

from typing import Any

import jax.numpy as jnp

from .._linalg import length
from .._pytree import pytree
from ._components import along, components, difference, dot, fraction, length_derivatives
from ._obstacles import PaddedObstacles, Size


@pytree
class Capsules(PaddedObstacles):
    """Balls swept along segments: `d = min_t |p - start - t (end - start)| - radius`. On the axis the gradient is zero.

    **Arguments**: `start`, `end` [n, 3], the ends of the axes, m; `radius` [n], m; `active` [n], bool, by default all.
    **Raises** `ConfigurationError` for a radius that is negative, `ShapeError` for wrong shapes.

    >>> from jaxrmp.world import World
    >>> World(capsules=Capsules.of([((0, 0, -1), (0, 0, 1), 0.5)])).signed_distance(jnp.array([2.0, 0, 0])).tolist()
    [1.5]
    """

    start: Any
    end: Any
    radius: Size[Any]
    active: Any = None
    _blank = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)

    def distance(self, p):
        axis, offset = self._axis_and_offset(p)
        t = fraction(dot(offset, axis), dot(axis, axis))
        return length(*along(offset, -t, axis)) - jnp.asarray(self.radius, p[0].dtype)

    def derivatives(self, p, v):
        axis, offset = self._axis_and_offset(p)
        square = dot(axis, axis)
        t = fraction(dot(offset, axis), square)
        slides = (t > 0) & (t < 1)
        rate = jnp.where(slides, dot(v, axis) / jnp.where(slides, square, 1), 0)
        (x, y, z), bend = length_derivatives(along(offset, -t, axis), along(v, -rate, axis))
        return (x, y, z), bend

    def _axis_and_offset(self, p):
        start = components(self.start, p[0].dtype)
        return difference(components(self.end, p[0].dtype), start), difference(p, start)

    def nearest_on_segment(self, a, b):
        """Ericson, Real-Time Collision Detection, section 5.1.9. Of parallel segments, the first nearest point."""
        dtype = a[0].dtype
        start = components(self.start, dtype)
        step, axis, between = difference(b, a), difference(components(self.end, dtype), start), difference(a, start)
        ss, aa, sa = dot(step, step), dot(axis, axis), dot(step, axis)
        sb, ab = dot(step, between), dot(axis, between)
        sine = ss * aa - sa * sa
        t = fraction(sa * ab - sb * aa, jnp.where(sine > jnp.finfo(dtype).eps * ss * aa, sine, 0))
        on_axis = jnp.where(aa > 0, (sa * t + ab) / jnp.where(aa > 0, aa, 1), 0)
        return fraction(sa * jnp.clip(on_axis, 0, 1) - sb, ss)
