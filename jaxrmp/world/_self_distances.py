"""The task map from joint positions to the distances between spheres on the robot itself."""

from collections.abc import Callable, Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, ShapeError
from .._pytree import pytree, set_field, static
from .._task_map import Pushforward, TaskMap, pushforward
from ._components import components, dot, length
from ._obstacle_distances import checked_radii, radii_of_points


@pytree
class SelfDistances(TaskMap):
    """Distances between P pairs of spheres on the robot: `d = |p_i - p_j| - r_i - r_j`, [P].

    Where two centres coincide, `J = c = 0`.

    **Arguments**: `points`, a map x [n] -> [K, 3], m; `pairs`, P pairs (i, j) of points; `radii` [K] or a number, m.
    **Raises** `ConfigurationError` for a negative radius or a pair of a point with itself, `ShapeError` for pairs
    that are not pairs and, when called, for points that are not there.

    >>> SelfDistances(lambda x: jnp.stack([x, -x]), pairs=((0, 1),), radii=0.25)(jnp.array([1.0, 0.0, 0.0])).tolist()
    [1.5]
    """

    points: Callable[[jax.Array], jax.Array]
    pairs: tuple[tuple[int, int], ...] = static()
    radii: Any = 0.0

    def __post_init__(self):
        given: Iterable = self.pairs
        pairs = tuple(tuple(int(i) for i in pair) for pair in given)
        for pair in pairs:
            if len(pair) != 2 or min(pair) < 0:
                raise ShapeError(f"pairs holds {pair}, expected pairs (i, j) of indices of points.")
            if pair[0] == pair[1]:
                raise ConfigurationError(f"pairs holds {pair}, a point and itself.")
        set_field(self, "pairs", pairs)
        set_field(self, "radii", checked_radii("SelfDistances", self.radii))

    def __call__(self, x):
        p = self.points(x)
        i, j, radii = self._ends(p)
        return length(*components(p[i] - p[j])) - radii

    def pushforward(self, x, xd):
        at = pushforward(self.points, x, xd)
        i, j, radii = self._ends(at.y)
        offset, v, c = (components(part[i] - part[j]) for part in (at.y, at.yd, at.c))
        r = length(*offset)
        apart = r > 0
        inverse = jnp.where(apart, 1 / jnp.where(apart, r, 1), 0)
        g = (offset[0] * inverse, offset[1] * inverse, offset[2] * inverse)
        rate = dot(g, v)
        J = at.J[i] - at.J[j]
        J = dot((g[0][:, None], g[1][:, None], g[2][:, None]), (J[:, 0], J[:, 1], J[:, 2]))
        return Pushforward(r - radii, rate, J, (dot(v, v) - rate * rate) * inverse + dot(g, c))

    def _ends(self, p):
        """First and second points of the pairs, and the sums of their radii."""
        pairs = np.array(self.pairs, dtype=int).reshape(-1, 2)
        if pairs.size and pairs.max() >= p.shape[0]:
            raise ShapeError(f"pairs names point {pairs.max()}, but there are {p.shape[0]} points.")
        radii = radii_of_points(self.radii, p)
        return pairs[:, 0], pairs[:, 1], radii[pairs[:, 0]] + radii[pairs[:, 1]]
