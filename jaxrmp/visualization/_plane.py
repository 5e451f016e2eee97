"""A learned three-dimensional field as seen in the plane that its demonstrations keep to."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ShapeError
from ..leaves import Learned


class Plane(NamedTuple):
    """A plane through the origin, where the goal is: `axes` [2, m], orthonormal; `share` of the squared distances from
    the goal that lies in it."""

    axes: np.ndarray
    share: float

    def project(self, x: np.ndarray) -> np.ndarray:
        """Coordinates [..., 2] in the plane of points or vectors `x` [..., m]."""
        return np.asarray(x, float) @ self.axes.T


class PlaneField(NamedTuple):
    """Potential and fields at the points `(u[i], v[j])` of a plane, `u` [U] and `v` [V], m.

    `potential` [V, U], m; `descent` [V, U, 2], `-grad Phi`, and `warped` [V, U, 2], `-M^-1 grad Phi`, both without
    the part that leaves the plane.
    """

    u: np.ndarray
    v: np.ndarray
    potential: np.ndarray
    descent: np.ndarray
    warped: np.ndarray


def demonstration_plane(positions: np.ndarray) -> Plane:
    """The plane through the goal that holds most of the demonstrations: their two first principal axes.

    Each axis points to the side of its largest component, so that like demonstrations give like pictures.

    **Arguments**: `positions` [..., m], m, with the goal at the origin, m >= 2.
    **Raises** `ShapeError` if there are fewer than two dimensions or points.
    """
    x = np.asarray(positions, float)
    x = x.reshape(-1, x.shape[-1]) if x.ndim else x
    if x.ndim != 2 or min(x.shape) < 2:
        raise ShapeError(f"positions have shape {np.shape(positions)}, expected [..., m] with two points and m >= 2.")
    _, spread, rows = np.linalg.svd(x, full_matrices=False)
    axes = rows[:2]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(1)[:, None], axis=1)
    total = float(np.sum(spread**2))
    return Plane(axes * np.where(largest < 0, -1.0, 1.0), float(np.sum(spread[:2] ** 2)) / total if total else 1.0)


def field_on_plane(learned: Learned, plane: Plane, u: np.ndarray, v: np.ndarray) -> PlaneField:
    """The potential, its negative gradient and the warped field on a grid of a plane through the goal.

    The field is evaluated at points of the plane, then projected onto it.

    **Arguments**: `learned`, the leaf of one subtask; `plane`; `u` [U] and `v` [V], m, coordinates along its axes.
    **Returns** a `PlaneField`.
    """
    u, v = np.asarray(u, float), np.asarray(v, float)
    grid = np.stack(np.meshgrid(u, v), axis=-1) @ plane.axes
    potential, descent, warped = fields_at(learned, grid)
    return PlaneField(u, v, potential, plane.project(descent), plane.project(warped))


def fields_at(learned: Learned, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`Phi` [...], `-grad Phi` and `-M^-1 grad Phi` [..., m] of one subtask's leaf at points x [..., m], m."""
    values = _evaluated(learned, jnp.asarray(x.reshape(-1, x.shape[-1])))
    potential, descent, warped = (np.asarray(a, float) for a in values)
    return potential.reshape(x.shape[:-1]), descent.reshape(x.shape), warped.reshape(x.shape)


@jax.jit
@partial(jax.vmap, in_axes=(None, 0))
def _evaluated(learned, x):
    potential, slope = jax.value_and_grad(learned.potential_of)(x)
    return potential, -slope, learned.field(x)
