"""The task map from joint positions to one point of the robot."""

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ShapeError
from .._forms import NaturalForm
from .._pytree import pytree, static
from .._task_map import Pushforward, TaskMap, Transport
from ._control_points import ControlPoints
from ._robot import Robot


@pytree
class Position(TaskMap):
    """Where a point fixed to a frame is in the world: `y = T_world_frame(q) offset`, a vector [3].

    `pullback(Position(robot, "hand"), leaves.Attractor(goal))` takes the hand to a goal.

    **Arguments**: `robot`; `frame`, the name of a body or site; `offset` [3], the point in it, m, default its origin.
    **Returns**, called with `q` [n], `y` [3], m; pushforward and transport are those of `ControlPoints`, for one point.
    **Raises** `UnknownNameError` for an unknown frame, `ShapeError` for an offset that is not [3].

    >>> from jaxrmp.kinematics import panda
    >>> [round(v, 3) for v in Position(panda(), "panda_link1")(np.zeros(7)).tolist()]
    [0.0, 0.0, 0.333]
    """

    robot: Robot
    frame: str = static()
    offset: jax.Array | np.ndarray | None = None

    def __post_init__(self):
        self.robot.frame_index(self.frame)
        if self.offset is not None and np.shape(self.offset) != (3,):
            raise ShapeError(f"offset has shape {np.shape(self.offset)}, expected (3,): a point in {self.frame!r}.")

    def __call__(self, x):
        return self._points()(x)[0]

    def pushforward(self, x, xd):
        return Pushforward(*(part[0] for part in self._points().pushforward(x, xd)))

    def transport(self, x, xd):
        y, yd, pull = self._points().transport(x, xd)

        def pull_form(form):
            form = form.dense()
            return pull(NaturalForm(form.f[None], form.M[None]))

        return Transport(y[0], yd[0], pull_form)

    def _points(self) -> ControlPoints:
        return ControlPoints(self.robot, self.frame, None if self.offset is None else jnp.asarray(self.offset)[None])
