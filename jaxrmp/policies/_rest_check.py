"""Whether an arm touches itself in a posture that it is to rest in."""

import warnings
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._counted import counted
from .._errors import ConfigurationError, UnsafeFileWarning
from ..kinematics import Robot
from ..world import RobotSpheres, SelfDistances
from ..world._own_spheres import mend_cover


def check_rest(robot: Robot, spheres: RobotSpheres, pairs: tuple[tuple[int, int], ...], rest: Any) -> None:
    """**Raises** `ConfigurationError` where spheres overlap in the posture `rest`, which is then none to rest in; for
    None, the `middle`, which nobody has chosen, an `UnsafeFileWarning`."""
    chosen, rest = rest is not None, robot.middle if rest is None else rest
    if not pairs or np.shape(rest) != (robot.num_joints,) or not np.isfinite(rest).all():
        return  # other shapes are refused by the posture's leaf
    gaps = np.asarray(SelfDistances(spheres.points(robot), pairs, spheres.radii)(jnp.asarray(rest, jnp.float32)))
    if not (gaps < 0).any():
        return
    k = int(np.argmin(gaps))
    links = spheres.frames[pairs[k][0]], spheres.frames[pairs[k][1]]
    where = "the posture rest" if chosen else "the middle of the joints, where it rests without another"
    several = counted(int((gaps < 0).sum()), "pair")
    told = (
        f"in {where}, spheres on {links[0]} and {links[1]} overlap by {-100 * gaps[k]:.1f} cm ({several} in all), so "
        f"that {robot.name!r} cannot rest there. Take another, such as policies.find_rest has. If the links are apart "
        f"there: {mend_cover(robot, spheres, [links], pairs)}"
    )
    if chosen:
        raise ConfigurationError(told)
    warnings.warn(told, UnsafeFileWarning, stacklevel=3)
