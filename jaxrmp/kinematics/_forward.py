"""Forward kinematics: where the robot's frames are."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp

from .._errors import ShapeError
from ._motion import move_frames
from ._robot import Robot


def forward_kinematics(robot: Robot, q: jax.Array, frame: str) -> jax.Array:
    """The pose of one frame.

    **Arguments**: `robot`; `q`, joint positions [n], rad or m; `frame`, the name of a body or site.
    **Returns** `T_world_frame` [4, 4]; differentiable, in `q`'s dtype.
    **Raises** `UnknownNameError` if there is no such frame, `ShapeError` if `q` is not [n].

    >>> from jaxrmp.kinematics import panda
    >>> round(float(forward_kinematics(panda(), jnp.zeros(7), "panda_link1")[2, 3]), 4)
    0.333
    """
    return frame_poses(robot, q, (frame,))[0]


def frame_poses(robot: Robot, q: jax.Array, frames: Sequence[str]) -> jax.Array:
    """The poses `T_world_frame` [K, 4, 4] of K `frames`, computing what they share once.

    The rest as `forward_kinematics`.
    """
    q = configuration(robot, q)
    motions, _ = move_frames(robot, frames, q)
    entries = []
    for _, pose in motions:
        for row in range(3):
            entries += [*pose.rotation[3 * row : 3 * row + 3], pose.position[row]]
        entries += [0.0, 0.0, 0.0, 1.0]
    return jnp.stack([jnp.asarray(entry, q.dtype) for entry in entries]).reshape(len(motions), 4, 4)


def configuration(robot: Robot, q: jax.Array, name: str = "q") -> jax.Array:
    """Return `q` as an array of floats. **Raises** `ShapeError` if it is not [n]."""
    q = jnp.asarray(q)
    if q.shape != (robot.num_joints,):
        hint = " To evaluate a batch, use jax.vmap." if q.ndim == 2 else ""
        raise ShapeError(
            f"{name} has shape {q.shape}, expected ({robot.num_joints},) for {robot.name!r} with joints "
            f"{list(robot.joint_names)}.{hint}"
        )
    return q if jnp.issubdtype(q.dtype, jnp.floating) else q.astype(float)
