"""Points of the robot as seen from other points and frames of it."""

from .._linalg import einsum, matmul
from .._pytree import pytree, static
from .._task_map import Pushforward, TaskMap, pushforward
from ._control_points import ControlPoints
from ._frame_axes import FrameAxes
from ._robot import Robot


@pytree
class RelativePoints(TaskMap):
    """Points less points, in world axes: `y = a(q) - b(q)`, such as one end-effector from the other's place.

    **Arguments**: `points_a`, `points_b`, two maps of the same joints to points [K, 3] (one of them may give [1, 3]),
    such as `ControlPoints` of two arms.
    **Returns**, called with `q` [n], the differences [K, 3], m.

    >>> import jax.numpy as jnp
    >>> from jaxrmp.kinematics import panda
    >>> hand, elbow = (ControlPoints(panda(), name) for name in ("panda_hand", "panda_link4"))
    >>> RelativePoints(hand, elbow)(jnp.zeros(7)).shape
    (1, 3)
    """

    points_a: TaskMap
    points_b: TaskMap

    def __call__(self, x):
        return self.points_a(x) - self.points_b(x)

    def pushforward(self, x, xd):
        a, b = pushforward(self.points_a, x, xd), pushforward(self.points_b, x, xd)
        return Pushforward(*(of_a - of_b for of_a, of_b in zip(a, b, strict=True)))


@pytree
class PointsInFrame(TaskMap):
    """Points in the axes of a moving frame of the robot: `y = R_world_frame(q)^T (p(q) - o_frame(q))`.

    As `RelativePoints`, but turning with the frame: what one hand holds, seen from the other hand.

    **Arguments**: `robot`; `frame`, the name of a body or site; `points`, a map of the same joints to points [K, 3].
    **Returns**, called with `q` [n], the points in the frame [K, 3], m.
    **Raises** `UnknownNameError` for an unknown frame.

    >>> import jax.numpy as jnp
    >>> from jaxrmp.kinematics import panda
    >>> hand = ControlPoints(panda(), "panda_hand")
    >>> bool(jnp.allclose(PointsInFrame(panda(), "panda_hand", hand)(jnp.ones(7)), 0.0, atol=1e-6))
    True
    """

    robot: Robot
    frame: str = static()
    points: TaskMap

    def __post_init__(self):
        self.robot.frame_index(self.frame)

    def __call__(self, x):
        return matmul(self._offsets()(x), FrameAxes(self.robot, self.frame)(x).T)

    def pushforward(self, x, xd):
        p, axes = self._offsets().pushforward(x, xd), FrameAxes(self.robot, self.frame).pushforward(x, xd)
        R_frame_world, R_world_frame = axes.y, axes.y.T
        J = einsum("ain,ki->kan", axes.J, p.y) + einsum("ai,kin->kan", R_frame_world, p.J)
        yd = matmul(p.y, axes.yd.T) + matmul(p.yd, R_world_frame)
        c = matmul(p.y, axes.c.T) + 2 * matmul(p.yd, axes.yd.T) + matmul(p.c, R_world_frame)
        return Pushforward(matmul(p.y, R_world_frame), yd, J, c)

    def _offsets(self) -> RelativePoints:
        return RelativePoints(self.points, ControlPoints(self.robot, (self.frame,)))
