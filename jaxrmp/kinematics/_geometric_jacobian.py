"""The Jacobian of a frame's twist."""

import jax

from ._forward import configuration
from ._jacobian import by_coordinate, moving, twists
from ._motion import move_frames
from ._robot import Robot


def geometric_jacobian(robot: Robot, q: jax.Array, frame: str) -> jax.Array:
    """The geometric Jacobian of one frame: `[v; omega] = J qd`, both in the world's axes, v of the frame's origin.

    **Arguments**: `robot`; `q`, joint positions [n], rad or m; `frame`, the name of a body or site.
    **Returns** `J` [6, n], the linear rows first; differentiable, in `q`'s dtype.
    **Raises** `UnknownNameError` if there is no such frame, `ShapeError` if `q` is not [n].

    >>> from jaxrmp.kinematics import panda
    >>> J = geometric_jacobian(panda(), jax.numpy.zeros(7), "panda_hand")
    >>> J.shape, J[3:, 0].tolist()
    ((6, 7), [0.0, 0.0, 1.0])

    Siciliano et al., Robotics: Modelling, Planning and Control, section 3.1.
    """
    q = configuration(robot, q)
    model = robot.model
    [(_, motion)], axes = move_frames(robot, (frame,), q)
    joints = moving(model, axes)
    return by_coordinate(model, joints, twists(model, joints, axes, motion.position, q.dtype).T).T
