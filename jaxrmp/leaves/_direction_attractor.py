"""Attraction to a direction, such as upwards, on the sphere itself."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import ConfigurationError, ShapeError
from .._gds import GeometricDynamicalSystem
from .._linalg import length
from .._pytree import pytree, set_field, static
from .._ranges import Finite, NonNegative, Positive
from ._rounded_well import rounded_well


@pytree
class DirectionAttractor(GeometricDynamicalSystem):
    """Turns a direction to a goal along the shortest way; the turn about it is left free.

    Its space are unit vectors y [3], such as one of `kinematics.FrameAxes`. The metric `w I` there is w on the angular
    velocity across the direction, and constant. With the angle t to the goal, `u = |y - y_goal|^2 / 4 = sin(t / 2)^2`:
    `Phi = 4 w stiffness u / (1 + sqrt(1 - (1 - rounding) u))`, `B = damping_rate G`, as of `OrientationAttractor`:
    the torque is `w stiffness t` near the goal, and goes on rising until close to the opposite direction, which is the
    only other rest point, and no minimum.

    **Arguments**: `direction` [3], the goal, of any length but zero; `weight` w, the metric per (rad)^2; `stiffness`,
    1/s^2; `damping_rate`, 1/s; `rounding`, in (0, 1].
    **Raises** `ShapeError` for a direction that is not [3], `ConfigurationError` for one of no length, a rounding that
    is not positive or another negative parameter.

    >>> leaf = DirectionAttractor(jnp.array([0.0, 0.0, 1.0]))
    >>> round(float(leaf.gap(jnp.array([1.0, 0.0, 0.0]))), 4)  # a quarter turn away
    1.5708

    Bullo and Lewis, Geometric Control of Mechanical Systems, chapter 11 (error functions on the sphere).
    """

    direction: Finite[jax.Array]
    weight: NonNegative[jax.Array | float] = 1.0
    stiffness: NonNegative[jax.Array | float] = 25.0
    damping_rate: NonNegative[jax.Array | float] = 10.0
    rounding: Positive[jax.Array | float] = 0.05
    name: str = static(default="direction_attractor")
    has_goal = True

    def __post_init__(self):
        if np.shape(self.direction) != (3,):
            raise ShapeError(f"direction has shape {np.shape(self.direction)}, expected (3,).")
        if not isinstance(self.direction, Tracer | jax.Array):
            given = np.asarray(self.direction, float)
            size = np.linalg.norm(given)
            if not 0 < size < np.inf:
                raise ConfigurationError(f"direction is {given.tolist()}, expected a finite vector of some length.")
            set_field(self, "direction", given / size)

    def gap(self, x: jax.Array) -> jax.Array:
        """The angle from `x` [3] to the goal, rad, for the inspector."""
        sine = length(x - self._goal(x)) / 2  # of half of it
        return 2 * jnp.arcsin(jnp.minimum(sine, 1 - jnp.finfo(x.dtype).eps))

    def metric(self, x, xd):
        return jnp.asarray(self.weight, x.dtype) * jnp.eye(3, dtype=x.dtype)

    def potential(self, x):
        offset = x - self._goal(x)
        return (4 * self.weight * self.stiffness * rounded_well(offset, 4, self.rounding)).astype(x.dtype)

    def damping(self, x, xd):
        return (self.damping_rate * self.metric(x, xd)).astype(x.dtype)

    def _goal(self, x):
        goal = jnp.asarray(self.direction, x.dtype)
        return goal / length(goal)
