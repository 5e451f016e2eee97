"""Attraction to an orientation, on SO(3) itself."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import ShapeError
from .._gds import GeometricDynamicalSystem
from .._linalg import length
from .._pytree import pytree, set_field, static
from .._ranges import NonNegative, Positive
from .._rotations import pose
from .._task_map import check_rigid
from ._rounded_well import rounded_well


@pytree
class OrientationAttractor(GeometricDynamicalSystem):
    """Turns a frame to a goal orientation along the shortest rotation.

    Its space is the rotation matrix, row by row, y [9] (`kinematics.FrameRotation`): no angles, so no chart and no
    singularity. The metric `G = w/2 I` there is `w I` on the angular velocity, `|Rdot|^2 = 2 |omega|^2`, and constant,
    so there are no curvature terms but those of the task map. With the angle t to the goal,
    `u = |y - y_goal|^2 / 8 = sin(t / 2)^2`:
    `Phi = 4 w stiffness u / (1 + sqrt(1 - (1 - rounding) u))`, `B = damping_rate G`. The torque is
    `w stiffness sin(t) / sqrt(1 - (1 - rounding) sin(t / 2)^2)` about the axis of the shortest rotation: w stiffness t
    near the goal, about `2 w stiffness sin(t / 2)` beyond, until it falls to zero within some `2 sqrt(rounding)` rad of
    half a turn. `rounding = 1` gives the plain `Phi = w stiffness (3 - trace(R_goal^T R)) / 2`.

    The only rest points are the goal and the half turns, where Phi is highest and no direction is shorter: a frame
    exactly there and at rest stays; any disturbance frees it. No smooth potential on SO(3) can do without such points.

    **Arguments**: `R_world_goal` [3, 3]; `weight` w, the metric per (rad)^2; `stiffness`, 1/s^2; `damping_rate`, 1/s;
    `rounding`, in (0, 1].
    **Raises** `RigidTransformError` if the goal is no rotation, `ShapeError` if it is not [3, 3], `ConfigurationError`
    for a rounding that is not positive or another negative parameter.

    >>> leaf = OrientationAttractor(R_world_goal=jnp.eye(3))
    >>> round(float(leaf.gap(jnp.array([0.0, -1, 0, 1, 0, 0, 0, 0, 1]))), 4)  # a quarter turn away
    1.5708

    Bullo and Lewis, Geometric Control of Mechanical Systems, chapter 11 (error functions on SO(3)).
    """

    R_world_goal: jax.Array
    weight: NonNegative[jax.Array | float] = 1.0
    stiffness: NonNegative[jax.Array | float] = 25.0
    damping_rate: NonNegative[jax.Array | float] = 10.0
    rounding: Positive[jax.Array | float] = 0.05
    name: str = static(default="orientation_attractor")
    has_goal = True

    def __post_init__(self):
        if not isinstance(self.R_world_goal, Tracer):
            R = np.asarray(self.R_world_goal)
            if R.shape != (3, 3):
                raise ShapeError(f"R_world_goal has shape {R.shape}, expected (3, 3).")
            check_rigid(pose(np.zeros(3), R), "R_world_goal")
        if not isinstance(self.R_world_goal, jax.Array):
            set_field(self, "R_world_goal", np.asarray(self.R_world_goal, float))

    def gap(self, x: jax.Array) -> jax.Array:
        """The angle from `x` [9] to the goal, rad, for the inspector."""
        sine = length(x - jnp.asarray(self.R_world_goal, x.dtype).reshape(9)) / 8**0.5  # of half of it
        return 2 * jnp.arcsin(jnp.minimum(sine, 1 - jnp.finfo(x.dtype).eps))

    def metric(self, x, xd):
        return 0.5 * jnp.asarray(self.weight, x.dtype) * jnp.eye(9, dtype=x.dtype)

    def potential(self, x):
        offset = x - jnp.asarray(self.R_world_goal, x.dtype).reshape(9)
        return (4 * self.weight * self.stiffness * rounded_well(offset, 8, self.rounding)).astype(x.dtype)
