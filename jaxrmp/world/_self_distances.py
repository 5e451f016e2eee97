"""The task map from joint positions to the distances between spheres on the robot itself."""

from collections.abc import Callable, Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, ShapeError
from .._forms import DiagonalForm, NaturalForm
from .._linalg import length, matmul
from .._pytree import as_floats, pytree, set_field, static
from .._ranges import Finite, NonNegative
from .._task_map import Pushforward, TaskMap, Transport, pushforward, transport_by_jacobian
from ..kinematics import ControlPoints
from ..kinematics._jacobian import line_rows
from ..kinematics._scalars import cross
from ..xla import materialise
from ._components import components, dot, length_derivatives
from ._obstacle_distances import radii_of_points


@pytree
class SelfDistances(TaskMap):
    """Distances between P pairs of spheres on the robot: `d = |p_i - p_j| - r_i - r_j`, [P].

    Where two centres coincide, `J = c = 0`.

    **Arguments**: `points`, a map x [n] -> [K, 3], m; `pairs`, P pairs (i, j) of points; `radii` [K] or a number, m.
    **Raises** `ConfigurationError` for a negative radius or a pair of a point with itself, `ShapeError` for pairs
    that are not pairs and, when called, for points that are not there.

    >>> import jax.numpy as jnp
    >>> SelfDistances(lambda x: jnp.stack([x, -x]), pairs=((0, 1),), radii=0.25)(jnp.array([1.0, 0.0, 0.0])).tolist()
    [1.5]
    """

    points: Callable[[jax.Array], jax.Array]
    pairs: tuple[tuple[int, int], ...] = static()
    radii: NonNegative[Finite[Any]] = 0.0

    def __post_init__(self):
        given: Iterable = self.pairs
        pairs = tuple(tuple(int(i) for i in pair) for pair in given)
        for pair in pairs:
            if len(pair) != 2 or min(pair) < 0:
                raise ShapeError(f"pairs holds {pair}, expected pairs (i, j) of indices of points.")
            if pair[0] == pair[1]:
                raise ConfigurationError(f"pairs holds {pair}, a point and itself.")
        set_field(self, "pairs", pairs)
        set_field(self, "radii", as_floats(self.radii))

    def __call__(self, x):
        p = self.points(x)
        i, j, radii = self._ends(p)
        return length(*components(p[i] - p[j])) - radii

    def pushforward(self, x, xd):
        at = pushforward(self.points, x, xd)
        i, j, radii = self._ends(at.y)
        offset, v, c = (components(part[i] - part[j]) for part in (at.y, at.yd, at.c))
        (x, y, z), bend = length_derivatives(offset, v)
        J = at.J[i] - at.J[j]
        J = dot((x[:, None], y[:, None], z[:, None]), (J[:, 0], J[:, 1], J[:, 2]))
        return Pushforward(length(*offset) - radii, dot((x, y, z), v), J, bend + dot((x, y, z), c))

    def transport(self, x, xd):
        if not isinstance(self.points, ControlPoints):
            return transport_by_jacobian(self, x, xd)
        # A joint moves two of the robot's own points apart by what it does along the line through them, so that what
        # is pulled back are lines, and no points: of their Jacobians only the differences are ever needed.
        at = self.points.motions(x, xd)
        i, j, radii = self._ends(jnp.stack(at.position, axis=1))
        # Columns are taken by products with ones and zeros, which are exact, and vectorise where gathers do not.
        first, second = (np.eye(len(at.bodies), dtype=x.dtype)[:, ends] for ends in (i, j))
        entries = materialise(jnp.stack([*at.position, *at.velocity, *at.acceleration]))
        p = matmul(entries[:3], first)
        between = matmul(entries, first - second).reshape(3, 3, len(i))
        offset, v, c = ((part[0], part[1], part[2]) for part in between)
        slopes, bend = length_derivatives(offset, v)
        u = (materialise(slopes[0]), materialise(slopes[1]), materialise(slopes[2]))

        def pull(form):
            ends = [at.bodies[k] for k in i], [at.bodies[k] for k in j]
            J = line_rows(self.points.robot.model, ends, u, cross((p[0], p[1], p[2]), u), at.axes, x.dtype)
            c_along = bend + dot(u, c)
            if isinstance(form, DiagonalForm):
                weight = materialise(form.d)
                return NaturalForm(matmul(J, materialise(form.f - weight * c_along)), matmul(J * weight, J.T))
            return NaturalForm(matmul(J, form.f - matmul(form.M, c_along)), matmul(matmul(J, form.M), J.T))

        return Transport(length(*offset) - radii, dot(u, v), pull)

    def _ends(self, p):
        """First and second points of the pairs, and the sums of their radii."""
        pairs = np.array(self.pairs, dtype=int).reshape(-1, 2)
        if pairs.size and pairs.max() >= p.shape[0]:
            raise ShapeError(f"pairs names point {pairs.max()}, but there are {p.shape[0]} points.")
        radii = radii_of_points(self.radii, p)
        return pairs[:, 0], pairs[:, 1], radii[pairs[:, 0]] + radii[pairs[:, 1]]
