"""Joint trajectories that take the gripper along a path of poses."""

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DemonstrationError, importing
from ..kinematics import Robot, forward_kinematics

with importing("scipy", "learning"):
    from scipy.optimize import least_squares

_MARGIN = 0.1  # rad, kept from the joint limits
_TOLERANCE, _LARGEST_STEP = 0.02, 0.2  # m off the path, and rad from one configuration to the next, at most
_LEVER = 0.2  # metres by which an orientation error counts as a position error
_POSTURE = 4e-3  # metres per radian away from the reference posture
_SMOOTHNESS = 4e-3  # metres per radian away from the configuration before


def follow(
    robot: Robot,
    frame: str,
    offset: np.ndarray,
    positions: np.ndarray,
    rotations: np.ndarray,
    postures: np.ndarray,
) -> np.ndarray:
    """Configurations `q` [T, n] that take a point of the robot along a path of poses, each seeded by the one before.

    **Arguments**: `offset` [3], the point in `frame`, m; `positions` [T, 3] and `rotations` [T, 3, 3], its path in
    the base; `postures` [T, n], rad, what the redundant joints lean to.
    **Raises** `DemonstrationError` if the path cannot be followed.
    """
    with jax.enable_x64(True):
        point = jnp.asarray(offset)

        def error(q, position, rotation, posture, before):
            T = forward_kinematics(robot, q, frame)
            return jnp.concatenate(
                [
                    T[:3, :3] @ point + T[:3, 3] - position,
                    _LEVER * (T[:3, :3] - rotation).ravel(),
                    _POSTURE * (q - posture),
                    _SMOOTHNESS * (q - before),
                ]
            )

        value, jacobian = jax.jit(error), jax.jit(jax.jacfwd(error))
        lower, upper = np.asarray(robot.lower) + _MARGIN, np.asarray(robot.upper) - _MARGIN

        def solve(q, target):
            solution = least_squares(
                lambda q, *goal: np.asarray(value(q, *goal)),
                np.clip(q, lower + 1e-6, upper - 1e-6),
                jac=lambda q, *goal: np.asarray(jacobian(q, *goal)),  # pyright: ignore[reportArgumentType]
                bounds=(lower, upper),
                args=(*target, q),
                xtol=1e-8,
                ftol=1e-8,
            )
            return solution.x, float(np.linalg.norm(solution.fun[:3]))

        targets = list(zip(positions, rotations, postures, strict=True))
        q, path = postures[0], []
        for _ in range(20):  # the first configuration has no good seed
            q, _ = solve(q, targets[0])
        for target in targets:
            before = q
            q, miss = solve(before, target)
            if miss > _TOLERANCE:
                raise DemonstrationError(
                    f"the scripted motion is out of reach: {miss:.3f} m from {target[0].round(3).tolist()}. Try "
                    "another seed."
                )
            if path and np.abs(q - before).max() > _LARGEST_STEP:
                raise DemonstrationError(
                    f"the scripted motion jumps at {target[0].round(3).tolist()}. Try another seed."
                )
            path.append(q)
    return np.stack(path)
