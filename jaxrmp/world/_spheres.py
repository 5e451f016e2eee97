"""Spheres."""

from typing import Any

import jax.numpy as jnp

from .._linalg import length
from .._pytree import pytree
from ._components import components, difference, dot, fraction, length_derivatives
from ._obstacles import PaddedObstacles, Size


@pytree
class Spheres(PaddedObstacles):
    """Balls: `d = |p - center| - radius`. At the centre the gradient is zero.

    **Arguments**: `center` [n, 3], m; `radius` [n], m; `active` [n], bool, by default all.
    **Raises** `ConfigurationError` for a radius that is negative, `ShapeError` for wrong shapes.

    >>> from jaxrmp.world import World
    >>> World(spheres=Spheres.of([((0, 0, 2), 0.5)], capacity=2)).signed_distance(jnp.zeros(3)).tolist()
    [1.5, 1000.0]
    """

    center: Any
    radius: Size[Any]
    active: Any = None
    _blank = ((0.0, 0.0, 0.0), 0.0)

    def distance(self, p):
        dtype = p[0].dtype
        return length(*difference(p, components(self.center, dtype))) - jnp.asarray(self.radius, dtype)

    def derivatives(self, p, v):
        (x, y, z), bend = length_derivatives(difference(p, components(self.center, p[0].dtype)), v)
        return (x, y, z), bend

    def nearest_on_segment(self, a, b):
        step = difference(b, a)
        return fraction(dot(difference(components(self.center, a[0].dtype), a), step), dot(step, step))
