"""Boxes."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .._pytree import pytree
from ._components import components, corner_derivatives, magnitude, outside_corner, rotated, to_local
from ._obstacles import PaddedObstacles, Size


@pytree
class Boxes(PaddedObstacles):
    """Boxes in any pose. Outside, the distance to the nearest point; inside, minus the distance to the nearest face.

    The gradient has length 1 everywhere; where two faces are equally near it is the normal of one of them.

    **Arguments**: `T_world_box` [n, 4, 4], poses of the middles; `half_extents` [n, 3], half the sides, m; `active`
    [n], bool, by default all.
    **Raises** `RigidTransformError` for a pose that is not rigid, `ConfigurationError` for extents that are negative,
    `ShapeError` for wrong shapes.

    >>> from jaxrmp.world import World
    >>> World(boxes=Boxes.of([(np.eye(4), (1, 1, 1))])).signed_distance(jnp.array([3.0, 0.0, 0.0])).tolist()
    [2.0]
    """

    T_world_box: Any
    half_extents: Size[Any]
    active: Any = None
    _blank = (np.eye(4), (0.0, 0.0, 0.0))

    def distance(self, p):
        _, faces = self._local(p)
        return outside_corner(*faces)

    def derivatives(self, p, v):
        local, faces = self._local(p)
        signs = [jnp.where(x >= 0, 1, -1).astype(x.dtype) for x in local]
        rates = [s * rate for s, rate in zip(signs, rotated(self.T_world_box, v), strict=True)]
        slopes, bend = corner_derivatives(faces, rates)
        x, y, z = (s * slope for s, slope in zip(signs, slopes, strict=True))
        return rotated(self.T_world_box, (x, y, z), back=True), bend

    def _local(self, p):
        """Points in the boxes' frames, and their signed distances to the three nearer faces."""
        local = to_local(self.T_world_box, p)
        half = components(self.half_extents, p[0].dtype)
        return local, [magnitude(x) - h for x, h in zip(local, half, strict=True)]
