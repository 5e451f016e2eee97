"""Task maps from points on a rigid hand to the space of its flow: where it is, and how it is turned."""

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import length, matmul
from .._pytree import pytree
from .._task_map import Pushforward, TaskMap, pushforward

_LEVER = 0.8  # of a triangle's radius: how far its corners are from axes in its plane and across, in the mean
_EDGE = 0.38  # cosine of half the largest turn that counts in full, 135 degrees
_BEYOND = 0.4226  # of half of that from where on turns alone fade, 130 degrees
_ENDED = 0.07  # of half of that where they have, 172 degrees


@pytree
class Stacked(TaskMap):
    """The points [K, 3] that `points` gives, as one vector [3 K] over sqrt(K): its length is their mean distance."""

    points: TaskMap

    def __call__(self, x):
        y = self.points(x)
        return y.reshape(-1) * len(y) ** -0.5

    def pushforward(self, x, xd):
        y, yd, J, c = pushforward(self.points, x, xd)
        k = len(y) ** -0.5
        return Pushforward(k * y.reshape(-1), k * yd.reshape(-1), k * J.reshape(-1, J.shape[-1]), k * c.reshape(-1))


@pytree
class HandPose(TaskMap):
    """Where a rigid hand is and how it is turned [6], m, from the stacked points [9] of a triangle on it.

    First the middle of the triangle, less that of `targets` [3, 3], m; then its turn away from theirs by an angle, as
    a vector along the axis, four times the tangent of a quarter of the angle, times `_LEVER` of the triangle's radius.
    Beyond 135 degrees that is led back, smoothly, to zero at 180: there the turn does not count, so that energies have
    no step where an axis changes its sign. `Stacked` says how far the points are from the `targets`.
    """

    targets: jax.Array

    def __call__(self, x):
        targets = jnp.asarray(self.targets, x.dtype)
        points = _points(x, targets)
        return jnp.concatenate([points.mean(0) - targets.mean(0), _turn(points, targets)])


@pytree
class HandTurn(TaskMap):
    """How a rigid hand is turned [3], m, wherever it is: as the last three numbers of `HandPose`, but not led back.

    So it has a step at the half turns, before which `TurnAttractor` has faded, by `BeyondTurn`. From 172 degrees on
    it is no longer than there.
    """

    targets: jax.Array

    def __call__(self, x):
        targets = jnp.asarray(self.targets, x.dtype)
        R, radius = _relative(_points(x, targets), targets)
        w = jnp.maximum(_real_part(R), _ENDED)
        return _LEVER * radius / (w * (1 + w)) * _twice_the_sine(R)


@pytree
class BeyondTurn(TaskMap):
    """How far a rigid hand is turned beyond what `HandTurn` is good for [1], from the same points: exactly 0 up to 130
    degrees from the `targets`, then rising with the angle alone, to 1 at 180.

    Smooth on all rotations, with no axis in it: its slope leads along the shortest rotation, and is zero at the half
    turns, where there is none.
    """

    targets: jax.Array

    def __call__(self, x):
        targets = jnp.asarray(self.targets, x.dtype)
        R, _ = _relative(_points(x, targets), targets)
        return (1 - step(jnp.minimum(_real_part(R) / _BEYOND, 1)))[None]


@pytree
class AboutMiddle(TaskMap):
    """The points [K, 3] that `points` gives, less their mean: how they are turned, wherever they are."""

    points: TaskMap

    def __call__(self, x):
        y = self.points(x)
        return y - y.mean(0)

    def pushforward(self, x, xd):
        return Pushforward(*(part - part.mean(0) for part in pushforward(self.points, x, xd)))


def turn_lengths(circumradius: float, degrees: np.ndarray) -> np.ndarray:
    """How long `HandTurn` is [S], m, at turns by `degrees` [S]."""
    return 4 * _LEVER * circumradius * np.tan(np.deg2rad(degrees) / 4)


def axes_of(triangle: jax.Array, radius: jax.Array) -> jax.Array:
    """The axes of an equilateral triangle [3, 3] as columns: to its first corner, along its opposite side, across."""
    x, y = triangle[0] - triangle.mean(0), (triangle[1] - triangle[2]) / 3**0.5
    return jnp.stack([x / radius, y / radius, jnp.cross(x, y) / radius**2], axis=1)


def _points(x: jax.Array, targets: jax.Array) -> jax.Array:
    """The points [3, 3] that are stacked in x [9]."""
    return len(targets) ** 0.5 * x.reshape(targets.shape) + targets


def _relative(points: jax.Array, targets: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The rotation [3, 3] of a triangle away from its targets, and its radius, m."""
    radius = length(targets[0] - targets.mean(0))
    return matmul(axes_of(points, radius), axes_of(targets, radius).T), radius


def _real_part(R: jax.Array) -> jax.Array:
    """The quaternion's real part, the cosine of half the angle."""
    return jnp.sqrt(jnp.maximum((1 + jnp.trace(R)) / 4, 1e-10))


def _twice_the_sine(R: jax.Array) -> jax.Array:
    """Twice the sine of the angle, along the axis [3]."""
    return jnp.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])


def step(t: jax.Array) -> jax.Array:
    """The quintic from 0 at 0 to 1 at 1."""
    return t**3 * (10 + t * (6 * t - 15))


def _turn(points: jax.Array, targets: jax.Array) -> jax.Array:
    R, radius = _relative(points, targets)
    w = _real_part(R)
    share = step(jnp.minimum(w / _EDGE, 1))
    return _LEVER * radius * share / (w * (1 + w)) * _twice_the_sine(R)
