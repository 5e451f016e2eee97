"""Cylinders."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .._linalg import length
from .._pytree import pytree
from ._components import corner_derivatives, length_derivatives, magnitude, outside_corner, rotated, to_local
from ._obstacles import PaddedObstacles, Size


@pytree
class Cylinders(PaddedObstacles):
    """Solid cylinders about the z axis of their frames, with flat ends.

    Outside, the distance to the nearest point; inside, minus the distance to the nearest of side and ends. On the
    axis, where the side is nearest, the gradient is zero.

    **Arguments**: `T_world_cylinder` [n, 4, 4], poses of the middles; `radius` [n], m; `half_length` [n], m; `active`
    [n], bool, by default all.
    **Raises** `RigidTransformError` for a pose that is not rigid, `ConfigurationError` for sizes that are negative,
    `ShapeError` for wrong shapes.

    >>> from jaxrmp.world import World
    >>> World(cylinders=Cylinders.of([(np.eye(4), 0.5, 1.0)])).signed_distance(jnp.array([2.0, 0, 0])).tolist()
    [1.5]
    """

    T_world_cylinder: Any
    radius: Size[Any]
    half_length: Size[Any]
    active: Any = None
    _blank = (np.eye(4), 0.0, 0.0)

    def distance(self, p):
        _, faces = self._local(p)
        return outside_corner(*faces)

    def derivatives(self, p, v):
        (x, y, z), faces = self._local(p)
        vx, vy, vz = rotated(self.T_world_cylinder, v)
        outwards, side_bend = length_derivatives((x, y), (vx, vy))
        sign = jnp.where(z >= 0, 1, -1).astype(z.dtype)
        slopes, bend = corner_derivatives(faces, (outwards[0] * vx + outwards[1] * vy, sign * vz))
        normal = (slopes[0] * outwards[0], slopes[0] * outwards[1], slopes[1] * sign)
        return rotated(self.T_world_cylinder, normal, back=True), bend + slopes[0] * side_bend

    def _local(self, p):
        """Points in the cylinders' frames, and their signed distances to side and nearer end."""
        dtype = p[0].dtype
        x, y, z = to_local(self.T_world_cylinder, p)
        side = length(x, y) - jnp.asarray(self.radius, dtype)
        return (x, y, z), (side, magnitude(z) - jnp.asarray(self.half_length, dtype))
