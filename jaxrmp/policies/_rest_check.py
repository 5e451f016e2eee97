"""Whether an arm touches itself in a posture that it is to rest in."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError
from ..kinematics import Robot
from ..world import RobotSpheres, SelfDistances
from ..world._own_spheres import mend_cover


def check_rest(robot: Robot, spheres: RobotSpheres, pairs: tuple[tuple[int, int], ...], rest: Any) -> None:
    """**Raises** `ConfigurationError` where spheres overlap in the posture `rest`, which is then none to rest in."""
    if rest is None or not pairs or np.shape(rest) != (robot.num_joints,) or not np.isfinite(rest).all():
        return  # other shapes are refused by the posture's leaf
    gaps = np.asarray(SelfDistances(spheres.points(robot), pairs, spheres.radii)(jnp.asarray(rest, jnp.float32)))
    if not (gaps < 0).any():
        return
    k = int(np.argmin(gaps))
    links = spheres.frames[pairs[k][0]], spheres.frames[pairs[k][1]]
    raise ConfigurationError(
        f"in the posture rest, spheres on {links[0]} and {links[1]} overlap by {-100 * gaps[k]:.1f} cm "
        f"({(gaps < 0).sum()} pairs do), so that {robot.name!r} cannot rest there. Take another, such as "
        f"policies.find_rest has. If the links are apart there: {mend_cover(robot, spheres, [links])}"
    )
