"""Where the robot itself is in what a camera sees."""

import jax
import jax.numpy as jnp

from ..kinematics import Robot
from ..world import RobotSpheres


def robot_spheres(robot: Robot, spheres: RobotSpheres, q: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Centres [K, 3] and radii [K] of `spheres` that hold the `robot`, at joint positions `q` [n], m, for `track`."""
    centers = spheres.points(robot)(q)
    return centers, jnp.asarray(spheres.radii, centers.dtype)
