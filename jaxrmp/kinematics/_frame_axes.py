"""The task maps from joint positions to the orientation of a frame."""

from typing import Any

import jax.numpy as jnp

from .._errors import ShapeError
from .._pytree import pytree, set_field, static
from .._task_map import Pushforward, TaskMap
from ._forward import configuration
from ._jacobian import as_jacobian, jacobian_rows, rows
from ._motion import BodyMotion, JointAxis, move_frames
from ._robot import Robot
from ._scalars import ZERO, Vector, add3, cross


@pytree
class FrameAxes(TaskMap):
    """Where the axes of a frame point in the world: the columns of its rotation matrix, `y_a = R_world_frame(q) e_a`.

    **Arguments**: `robot`; `frame`, the name of a body or site; `axes`, which of its axes, 0 for x, 1 for y, 2 for z.
    **Returns**, called with `q` [n], the unit vectors `y` [A, 3]. Its pushforward gives them with their velocities
    `omega x y` [A, 3], Jacobians `J` [A, 3, n], whose column i is `z_i x y_a` for a revolute joint with axis `z_i` and
    zero for a prismatic one, and `c = alpha x y + omega x (omega x y)` with the angular acceleration at `qdd = 0`.
    **Raises** `UnknownNameError` for an unknown frame, `ShapeError` for axes other than 0, 1, 2.

    >>> from jaxrmp.kinematics import panda
    >>> [round(v, 4) + 0.0 for v in FrameAxes(panda(), "panda_link1", axes=2)(jnp.zeros(7))[0].tolist()]
    [0.0, 0.0, 1.0]

    Siciliano et al., Robotics: Modelling, Planning and Control, section 3.1.
    """

    robot: Robot
    frame: str = static()
    axes: tuple[int, ...] = static(default=(0, 1, 2))

    def __post_init__(self):
        self.robot.frame_index(self.frame)
        given: Any = self.axes
        axes = tuple(int(a) for a in (given if isinstance(given, list | tuple) else (given,)))
        if not axes or not set(axes) <= {0, 1, 2}:
            raise ShapeError(f"axes is {given!r}, expected one or more of 0 (x), 1 (y), 2 (z).")
        set_field(self, "axes", axes)

    def __call__(self, x):
        x = configuration(self.robot, x)
        [(_, motion)], _ = move_frames(self.robot, (self.frame,), x)
        return rows(self._directions(motion, x.dtype), (len(self.axes),), x.dtype)

    def pushforward(self, x, xd):
        x, xd = configuration(self.robot, x), configuration(self.robot, xd, "xd")
        model, A = self.robot.model, len(self.axes)
        [(body, motion)], axes = move_frames(self.robot, (self.frame,), x, xd)
        y = self._directions(motion, x.dtype)
        swing = cross(motion.omega, y)
        pull = add3(cross(motion.alpha, y), cross(motion.omega, swing))
        # A direction is a point without an origin: only rotation moves it, about any point of an axis alike.
        turning = {
            i: JointAxis(axis.direction if model.joints[i].kind == "revolute" else ZERO, ZERO)
            for i, axis in axes.items()
        }
        J = as_jacobian(jacobian_rows(model, (body,) * A, y, turning, x.dtype))
        y, yd, c = (rows(vector, (A,), x.dtype) for vector in (y, swing, pull))
        return Pushforward(y, yd, J, c)

    def _directions(self, motion: BodyMotion, dtype: Any) -> Vector:
        """The chosen columns of the rotation, components [A]."""
        chosen = [[motion.rotation[row + a] for a in self.axes] for row in (0, 3, 6)]
        x, y, z = (jnp.stack([jnp.asarray(entry, dtype) for entry in entries]) for entries in chosen)
        return x, y, z


@pytree
class FrameRotation(TaskMap):
    """The rotation matrix `R_world_frame(q)` of a frame, row by row, as a vector `y` [9].

    **Arguments**: `robot`; `frame`, the name of a body or site. The pushforward is that of `FrameAxes`, and
    `J^T J = 2 J_omega^T J_omega` with the Jacobian of the angular velocity.
    **Raises** `UnknownNameError` for an unknown frame.

    >>> from jaxrmp.kinematics import panda
    >>> FrameRotation(panda(), "panda_link1")(jnp.zeros(7)).shape
    (9,)
    """

    robot: Robot
    frame: str = static()

    def __post_init__(self):
        self.robot.frame_index(self.frame)

    def __call__(self, x):
        return self._axes()(x).T.reshape(9)

    def pushforward(self, x, xd):
        carried = self._axes().pushforward(x, xd)
        return Pushforward(*(jnp.swapaxes(part, 0, 1).reshape(9, *part.shape[2:]) for part in carried))

    def _axes(self) -> FrameAxes:
        return FrameAxes(self.robot, self.frame)
