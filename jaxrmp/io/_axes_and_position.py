"""The task map on which axis targets with a proximity boost live."""

import jax.numpy as jnp

from .._pytree import pytree, static
from .._task_map import Pushforward, TaskMap
from ..kinematics import ControlPoints, FrameAxes, Robot


@pytree
class AxesAndPosition(TaskMap):
    """Axes of a frame, each with the frame's position behind it: `y_a = (n_a(q), x(q))`, `y` [A, 6].

    **Arguments**: `robot`; `frame`; `axes`, which of its axes, as `FrameAxes`.
    """

    robot: Robot
    frame: str = static()
    axes: tuple[int, ...] = static(default=(0, 1, 2))

    def __call__(self, x):
        n, p = (part(x) for part in self._parts())
        return jnp.concatenate([n, jnp.broadcast_to(p, n.shape)], axis=1)

    def pushforward(self, x, xd):
        directions, position = (part.pushforward(x, xd) for part in self._parts())
        pairs = zip(directions, position, strict=True)
        return Pushforward(*(jnp.concatenate([n, jnp.broadcast_to(p, n.shape)], axis=1) for n, p in pairs))

    def _parts(self) -> tuple[TaskMap, TaskMap]:
        return FrameAxes(self.robot, self.frame, self.axes), ControlPoints(self.robot, (self.frame,))
