"""Pairs of a robot's spheres that come nowhere near each other: nothing need keep them apart."""

import numpy as np

from .._errors import ConfigurationError
from ..kinematics import Robot
from ._mostly_touching import centers, random_configurations
from ._robot_spheres import RobotSpheres

_BLOCKS, _BLOCK = 20, 500  # of configurations; each block looks at those pairs alone that are left


def without_never_near(
    robot: Robot, spheres: RobotSpheres, pairs: tuple[tuple[int, int], ...], within: float = 0.1
) -> tuple[tuple[int, int], ...]:
    """The `pairs` of `spheres` without those that are farther apart than `within`, m, in each of 10,000 random
    configurations of the `robot`, drawn evenly between the joints' limits.

    It is no proof. So `within` is to be well above where what keeps them apart is felt: twice its `reach`.
    **Raises** `ConfigurationError` for a `within` that is no distance.
    """
    if not within >= 0:
        raise ConfigurationError(f"within is {within!r}, expected a distance of 0 m or more.")
    if not pairs:
        return ()
    ends, radii = np.array(pairs), np.asarray(spheres.radii, float)
    limit = radii[ends].sum(1) + within
    left = np.arange(len(pairs))  # so far never near
    for q in random_configurations(robot, _BLOCKS * _BLOCK, seed=1).reshape(_BLOCKS, _BLOCK, -1):
        at = centers(robot, spheres, q).astype(np.float32)
        near = np.zeros(len(left), bool)
        for rows in np.array_split(np.arange(len(left)), max(len(left) // 256, 1)):
            apart = at[:, ends[left[rows], 0]] - at[:, ends[left[rows], 1]]
            near[rows] = (np.einsum("nkx,nkx->nk", apart, apart) < limit[left[rows]] ** 2).any(0)
        left = left[~near]
        if not len(left):
            break
    far = set(left.tolist())
    return tuple(pair for k, pair in enumerate(pairs) if k not in far)
