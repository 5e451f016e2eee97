"""The task map from joint positions to the distances between the robot's spheres and the obstacles."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ShapeError
from .._forms import DiagonalForm, NaturalForm
from .._materialise import materialise
from .._pytree import pytree, set_field
from .._task_map import Pushforward, TaskMap, Transport, pull_form, pushforward, transport
from ._components import Point, columns, dot
from ._obstacles import FAR, refuse_negative
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
    radii: Any = 0.0

    def __post_init__(self):
        set_field(self, "radii", checked_radii("ObstacleDistances", self.radii))

    def __call__(self, x):
        p = self.points(x)
        radii = radii_of_points(self.radii, p)
        distance = self.world.of_each(p, lambda kind: kind.distance(columns(p))) - radii[:, None]
        return self.world.only_active(distance, FAR).reshape(-1)

    def pushforward(self, x, xd):
        at = pushforward(self.points, x, xd)
        d, g, bend = self._from_points(at.y, at.yd)
        return carried(d, g, bend, at)

    def transport(self, x, xd):
        p, v, pull_to_x = transport(self.points, x, xd)
        d, g, bend = self._from_points(p, v)
        d, bend = materialise(d), materialise(bend)
        g = (materialise(g[0]), materialise(g[1]), materialise(g[2]))
        rate = dot(g, columns(v))

        def pull(form):
            if not isinstance(form, DiagonalForm):
                return pull_form(self.pushforward(x, xd), form, x.ndim)
            # What the obstacles ask of one point is one form there: O distances, but only one Jacobian.
            weight = materialise(form.d.reshape(d.shape))
            force = materialise(form.f.reshape(d.shape) - weight * bend)
            # Sums as products with ones: a reduction over a short last axis is no loop that XLA:CPU vectorises.
            ones = jnp.ones(d.shape[1:], d.dtype)
            f = [(force * n) @ ones for n in g]
            pulls = [weight * n for n in g]
            M = {(i, j): (pulls[i] * g[j]) @ ones for i in range(3) for j in range(i + 1)}
            rows = [jnp.stack([M[max(i, j), min(i, j)] for j in range(3)], axis=-1) for i in range(3)]
            return pull_to_x(NaturalForm(jnp.stack(f, axis=-1), jnp.stack(rows, axis=-2)))

        return Transport(d.reshape(-1), rate.reshape(-1), pull)

    def _from_points(self, p, v):
        """Distances [K, O], their normals, and their second derivatives along the points' velocities."""
        radii, world = radii_of_points(self.radii, p), self.world
        at, along = columns(p), columns(v)
        distance = world.of_each(p, lambda kind: kind.distance(at)) - radii[:, None]
        none = jnp.zeros((*p.shape[:-1], 0), p.dtype)
        parts = [(none,) * 4, *((*g, bend) for g, bend in (kind.derivatives(at, along) for kind in world.kinds))]
        x, y, z, bend = (
            world.only_active(jnp.concatenate(column, axis=-1), 0.0) for column in zip(*parts, strict=True)
        )
        return world.only_active(distance, FAR), (x, y, z), bend


def carried(d: jax.Array, g: Point, bend: jax.Array, at: Pushforward) -> Pushforward:
    """The pushforward of distances [K, O] whose normals are `g` and whose second derivatives along pd are `bend`."""
    v, c = columns(at.yd), columns(at.c)
    rows = (at.J[:, 0, None, :], at.J[:, 1, None, :], at.J[:, 2, None, :])
    J = dot((g[0][..., None], g[1][..., None], g[2][..., None]), rows)
    return Pushforward(d.reshape(-1), dot(g, v).reshape(-1), J.reshape(-1, J.shape[-1]), (bend + dot(g, c)).reshape(-1))


def checked_radii(owner: str, radii: Any) -> Any:
    """`radii` as an array. **Raises** `ConfigurationError` if one is negative."""
    radii = radii if isinstance(radii, jax.Array) else np.asarray(radii, dtype=float)
    refuse_negative(owner, radii=radii)
    return radii


def radii_of_points(radii: Any, p: jax.Array) -> jax.Array:
    """`radii`, one or K, as [K] for points [K, 3]. **Raises** `ShapeError`."""
    if p.ndim != 2 or p.shape[1] != 3:
        raise ShapeError(f"points have shape {p.shape}, expected [K, 3].")
    if jnp.shape(radii) not in ((), p.shape[:1]):
        raise ShapeError(f"radii has shape {jnp.shape(radii)}, expected () or ({p.shape[0]},): one per point.")
    return jnp.broadcast_to(jnp.asarray(radii, p.dtype), p.shape[:1])
