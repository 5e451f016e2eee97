"""Half-spaces: floors, walls, virtual fences."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import ConfigurationError
from .._pytree import pytree, set_field
from ._components import components, dot
from ._obstacles import PaddedObstacles


@pytree
class HalfSpaces(PaddedObstacles):
    """All that lies behind planes: `d = normal . p - offset`; points with `normal . p >= offset` are free.

    **Arguments**: `normal` [n, 3], towards the free side, of any length but zero; `offset` [n], in units of
    `normal . p`; both are scaled to unit normals. `active` [n], bool, by default all.
    **Raises** `ConfigurationError` for a normal of length zero, `ShapeError` for wrong shapes.

    >>> from jaxrmp.world import World
    >>> floor = HalfSpaces.of([((0, 0, 1), 0.0)])
    >>> World(half_spaces=floor).signed_distance(jnp.array([0.0, 0.0, 0.5])).tolist()
    [0.5]
    """

    normal: Any
    offset: Any
    active: Any = None
    _blank = ((0.0, 0.0, 1.0), 0.0)

    def __post_init__(self):
        super().__post_init__()
        zero = [] if isinstance(self.normal, Tracer) else np.flatnonzero((np.asarray(self.normal) == 0).all(-1))
        if len(zero):
            raise ConfigurationError(
                f"normal of HalfSpaces is zero for obstacle {zero[0]}: give the free side's direction."
            )
        fields: Any = (self.normal, self.offset, self.active)
        numerics: Any = jnp if any(isinstance(a, jax.Array) for a in fields) else np
        # What is ignored stays so, but by way of a normal that has a length, and so has gradients.
        found, _ = self.usable()
        square = (found.normal * found.normal).sum(-1)
        good, nan = (found.active | ~self.active) & (square > 0), numerics.nan
        size = numerics.sqrt(numerics.where(square > 0, square, 1))
        set_field(self, "normal", numerics.where(good[:, None], found.normal / size[:, None], nan))
        set_field(self, "offset", numerics.where(good, found.offset / size, nan))

    def distance(self, p):
        dtype = p[0].dtype
        return dot(components(self.normal, dtype), p) - jnp.asarray(self.offset, dtype)

    def derivatives(self, p, v):
        flat = jnp.zeros(jnp.broadcast_shapes(p[0].shape, (self.size,)), p[0].dtype)
        x, y, z = (flat + n for n in components(self.normal, p[0].dtype))
        return (x, y, z), flat

    def nearest_on_segment(self, a, b):
        return (self.distance(b) < self.distance(a)).astype(a[0].dtype)
