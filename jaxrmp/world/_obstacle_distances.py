"""The task map from joint positions to the distances between the robot's spheres and the obstacles."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from .._errors import ShapeError
from .._forms import DiagonalForm, NaturalForm
from .._pytree import as_floats, pytree, set_field
from .._ranges import Finite, NonNegative
from .._task_map import Pushforward, TaskMap, Transport, pull_form, pushforward, transport
from ..xla import one_loop
from ._components import Point, columns, dot
from ._obstacles import FAR, PaddedObstacles
from ._world import World


@pytree
class ObstacleDistances(TaskMap):
    """Distances of K spheres on the robot to O obstacles: `d_ko = sdf_o(p_k(x)) - r_k`, [K O], k first.

    With the normal `g = grad sdf_o`: `dd = g . pd`, `J = g^T J_p`, `c = pd^T H pd + g . c_p`. Positive outside, zero
    at contact, negative inside. An inactive slot gives d = 1e3 with J = c = 0.

    **Arguments**: `points`, a map x [n] -> [K, 3], such as `ControlPoints`, m; `world`; `radii` [K] or a number, m.
    **Raises** `ConfigurationError` for a negative radius, `ShapeError` when called if shapes do not fit.

    >>> from jaxrmp.world import Spheres
    >>> scene = World(spheres=Spheres.of([((0, 0, 2), 0.5)]))
    >>> ObstacleDistances(lambda x: x[None], scene, radii=0.25)(jnp.zeros(3)).tolist()
    [1.25]
    """

    points: Callable[[jax.Array], jax.Array]
    world: World
    radii: NonNegative[Finite[Any]] = 0.0

    def __post_init__(self):
        set_field(self, "radii", as_floats(self.radii))

    def __call__(self, x):
        p = self.points(x)
        radii = radii_of_points(self.radii, p)
        distance = self.world.over_kinds(p, lambda kind: kind.distance(columns(p))) - radii[:, None]
        return self.world.mask_inactive(distance, FAR).reshape(-1)

    def pushforward(self, x, xd):
        at = pushforward(self.points, x, xd)
        d, _, g, bend = self._from_points(at.y, at.yd)
        return carried(d, g, bend, at)

    def transport(self, x, xd):
        p, v, pull_to_x = transport(self.points, x, xd)
        d, rate, g, bend = self._from_points(p, v)

        def pull(form):
            if not isinstance(form, DiagonalForm):
                return pull_form(self.pushforward(x, xd), form, x.ndim)
            # What the obstacles ask of one point is one form there: O distances, but only one Jacobian.
            asked = _asked(form.f.reshape(d.shape), form.d.reshape(d.shape), g, bend)
            return pull_to_x(NaturalForm(*_forms_of_points(*asked)))

        return Transport(d.reshape(-1), rate.reshape(-1), pull)

    def _from_points(self, p, v):
        """Distances [K, O], their rates, normals, and second derivatives along the points' velocities."""
        radii = radii_of_points(self.radii, p)
        parts = [(jnp.zeros((p.shape[0], 0), p.dtype),) * 6]
        for kind in self.world.kinds:
            if isinstance(kind, PaddedObstacles):
                parts.append(_pairs(kind, radii, p, v))
            else:
                parts.append(_pair(kind, radii[:, None], jnp.stack(columns(p)), jnp.stack(columns(v))))
        one = len(parts) == 2
        d, rate, x, y, z, bend = parts[1] if one else (jnp.concatenate(c, axis=-1) for c in zip(*parts, strict=True))
        return d, rate, (x, y, z), bend


def _pair(obstacles, radius, p, v):
    """Distances of a sphere to obstacles, their rates, normals, and second derivatives along the sphere's velocity."""
    at, along = (p[0], p[1], p[2]), (v[0], v[1], v[2])
    normal, bend = obstacles.derivatives(at, along)
    found = (obstacles.distance(at) - radius, dot(normal, along), *normal, bend)
    return tuple(jnp.where(obstacles.active, value, 0.0 if i else FAR) for i, value in enumerate(found))


def _of_one(slot, radius, p, v):
    """As `_pair`, for one slot."""
    obstacles = jax.tree.map(lambda x: jnp.asarray(x)[None], slot)
    return [value[0] for value in _pair(obstacles, radius, p[:, None], v[:, None])]


_pairs = one_loop(_of_one, (None, 0, 0, 0), (0, None, None, None))


def _of_distance(f, d, g, bend):
    """Force and metric at a point for a distance there: `f n`, and the lower triangle of `d n n^T`, row by row."""
    force = f - d * bend
    weighted = [d * n for n in g]
    return (*(force * n for n in g), *(weighted[i] * g[j] for i in range(3) for j in range(i + 1)))


def _of_distances(f, d, g, bend):
    """What distances [O] ask of a point together."""
    return list(jnp.sum(jnp.stack(one_loop(_of_distance, (0,) * 4)(f, d, g, bend)), axis=1))


_asked = one_loop(_of_distances, (0,) * 4)


@one_loop
def _forms_of_points(x, y, z, xx, yx, yy, zx, zy, zz):
    rows = [jnp.stack(row, axis=-1) for row in ((xx, yx, zx), (yx, yy, zy), (zx, zy, zz))]
    return jnp.stack([x, y, z], axis=-1), jnp.stack(rows, axis=-2)


def carried(d: jax.Array, g: Point, bend: jax.Array, at: Pushforward) -> Pushforward:
    """The pushforward of distances [K, O] whose normals are `g` and whose second derivatives along pd are `bend`."""
    v, c = columns(at.yd), columns(at.c)
    J = dot((g[0][..., None], g[1][..., None], g[2][..., None]), rows_of(at.J))
    return Pushforward(d.reshape(-1), dot(g, v).reshape(-1), J.reshape(-1, J.shape[-1]), (bend + dot(g, c)).reshape(-1))


def rows_of(J: jax.Array) -> Point:
    """The three rows of Jacobians [K, 3, n], each [K, 1, n]."""
    return J[:, 0, None], J[:, 1, None], J[:, 2, None]


def radii_of_points(radii: Any, p: jax.Array) -> jax.Array:
    """`radii`, one or K, as [K] for points [K, 3]. **Raises** `ShapeError`."""
    if p.ndim != 2 or p.shape[1] != 3:
        raise ShapeError(f"points have shape {p.shape}, expected [K, 3].")
    if jnp.shape(radii) not in ((), p.shape[:1]):
        raise ShapeError(f"radii has shape {jnp.shape(radii)}, expected () or ({p.shape[0]},): one per point.")
    return jnp.broadcast_to(jnp.asarray(radii, p.dtype), p.shape[:1])
