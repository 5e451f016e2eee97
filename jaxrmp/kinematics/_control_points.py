"""The task map from joint positions to points on the robot."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ShapeError
from .._forms import NaturalForm
from .._linalg import matmul
from .._pytree import as_floats, pytree, set_field, static
from .._task_map import Pushforward, TaskMap, Transport
from ..xla import concatenated, one_loop
from ._forward import configuration
from ._jacobian import as_jacobian, jacobian_rows, rows
from ._motion import BodyMotion, JointAxis, carry, known_motion, move, move_frames, turns_at
from ._robot import Robot
from ._scalars import Vector, rotate
from ._slopes import slopes_of_points, with_slopes


class PointMotions(NamedTuple):
    """K points on a robot: motions, entries [K], accelerations those at `qdd = 0`; their bodies; the joints' axes."""

    position: Vector
    velocity: Vector
    acceleration: Vector
    bodies: tuple[int, ...]
    axes: dict[int, JointAxis]


@one_loop
def _as_points(*vectors: Vector) -> tuple[jax.Array, ...]:
    return tuple(jnp.stack(vector, axis=1) for vector in vectors)


@pytree
class ControlPoints(TaskMap):
    """Where K points fixed to the robot are in the world: `y_k = T_world_frame_k(q) offset_k`.

    **Arguments**: `robot`; `frames`, the K frames that the points are fixed to (one name stands for K equal ones);
    `offsets` [K, 3], the points in their frames, m, a parameter; by default the frames' origins, None.
    **Returns**, called with `q` [n], the points `y` [K, 3]. Its pushforward gives them with their velocities
    [K, 3], Jacobians `J` [K, 3, n] and `c = Jdot qd` [K, 3] in one pass: column i of J is `z_i x (y - o_i)` for a
    revolute joint with axis `z_i` through `o_i`, and `z_i` for a prismatic one.
    **Raises** `UnknownNameError` for an unknown frame, `ShapeError` for wrong shapes.

    >>> from jaxrmp.kinematics import panda
    >>> jax.eval_shape(ControlPoints(panda(), "panda_hand", np.zeros((2, 3))), np.zeros(7)).shape
    (2, 3)

    Siciliano et al., Robotics: Modelling, Planning and Control, section 3.1.
    """

    robot: Robot
    frames: tuple[str, ...] = static()
    offsets: jax.Array | np.ndarray | None = None

    def __post_init__(self):
        given: Any = self.frames
        several = not isinstance(given, str)
        frames: tuple[str, ...] = tuple(given) if several else (given,)
        for name in frames:
            self.robot.frame_index(name)
        offsets: Any = self.offsets
        if offsets is not None:
            offsets = as_floats(offsets)
            if offsets.ndim == 2 and not several:
                frames *= offsets.shape[0]
            if offsets.shape != (len(frames), 3):
                raise ShapeError(f"offsets has shape {offsets.shape}, expected ({len(frames)}, 3): one row per frame.")
        if not frames:
            raise ShapeError("frames is empty, expected the frame of each point.")
        set_field(self, "frames", frames)
        set_field(self, "offsets", offsets)

    def __call__(self, x):
        x = configuration(self.robot, x)
        motions, _ = self._point_motions(x, None, None, self.offsets)
        return self._ordered(jnp.concatenate([rows(motion.position, (len(k),), x.dtype) for _, k, motion in motions]))

    def pushforward(self, x, xd):
        x, xd = configuration(self.robot, x), configuration(self.robot, xd, "xd")
        position, velocity, acceleration, axes = self._motions(x, xd, None)
        J = jacobian_rows(self.robot.model, self._bodies(), position, axes, x.dtype)
        y, yd, c = _as_points(position, velocity, acceleration)
        return Pushforward(y, yd, as_jacobian(J), c)

    def transport(self, x, xd):
        motions = self.motions(x, xd)
        y, yd, c = _as_points(motions.position, motions.velocity, motions.acceleration)

        @one_loop
        def pull(f, M, c, position, axes):
            M = [[M[:, i, j] for j in range(3)] for i in range(3)]
            f = [f[:, i] - sum(M[i][j] * c[:, j] for j in range(3)) for i in range(3)]
            J = jacobian_rows(self.robot.model, motions.bodies, position, axes, x.dtype)
            MJ = [jnp.asarray(sum(M[i][j] * J[j] for j in range(3))) for i in range(3)]
            # One product of all components: where it is no loop of scalars, XLA:CPU takes as long for a small one.
            whole = jnp.concatenate(J, axis=1)
            return matmul(whole, jnp.concatenate(f)), matmul(whole, jnp.concatenate(MJ, axis=1).T)

        def pull_form(form):
            form = form.dense()
            return NaturalForm(*pull(form.f, form.M, c, motions.position, motions.axes))

        return Transport(y, yd, pull_form)

    def motions(self, x: jax.Array, xd: jax.Array) -> PointMotions:
        """What the Jacobian of the points, and of distances between them, is made of, at `x, xd` [n]."""
        x, xd = configuration(self.robot, x), configuration(self.robot, xd, "xd")
        bodies = self._bodies()
        turns = turns_at(self.robot.model, bodies, x)
        position, velocity, acceleration, axes = one_loop(self._motions)(x, xd, turns)
        return PointMotions(position, velocity, acceleration, bodies, axes)

    def _bodies(self) -> tuple[int, ...]:
        return tuple(self.robot.model.frames[self.robot.frame_index(name)].body for name in self.frames)

    def _motions(self, x, xd, turns):
        model, bodies = self.robot.model, self._bodies()
        met = tuple(sorted(set(bodies)))

        def slopes(arguments, changes):
            (*arguments, offsets), (*changes, moved) = arguments, changes
            offsets, moved = jax.jvp(self._offsets_of_bodies, (offsets,), (moved,))
            at_rest = partial(move, model, met, qd=None)
            return slopes_of_points(model, at_rest, bodies, (*arguments, offsets), (*changes, moved))

        points = (jnp.zeros(len(bodies)),) * 3
        known = points, points, points, known_motion(model, met, True)[1]
        turns = turns_at(model, met, x) if turns is None else turns
        offsets = jnp.zeros((len(bodies), 3), x.dtype) if self.offsets is None else jnp.asarray(self.offsets, x.dtype)
        return with_slopes(self._carried, known, slopes, x, xd, turns, offsets)

    def _offsets_of_bodies(self, offsets: jax.Array) -> jax.Array:
        """From those in their frames [K, 3] those in the frames' bodies [3, K]."""
        frames = [self.robot.model.frames[self.robot.frame_index(name)] for name in self.frames]
        R = np.array([frame.rotation for frame in frames], offsets.dtype).reshape(-1, 3, 3)
        return (jnp.sum(R * offsets[:, None], axis=-1) + np.array([frame.position for frame in frames], R.dtype)).T

    def _carried(self, x, xd, turns, offsets):
        motions, axes = self._point_motions(x, xd, turns, None if self.offsets is None else offsets)
        groups: list[list[jax.Array]] = []
        for _, k, motion in motions:
            entries = (*motion.position, *motion.velocity, *motion.acceleration)
            groups.append([jnp.broadcast_to(jnp.asarray(v, x.dtype), (len(k),)) for v in entries])
        x, y, z, *rest = (self._ordered(column) for column in concatenated(list(zip(*groups, strict=True))))
        return (x, y, z), (rest[0], rest[1], rest[2]), (rest[3], rest[4], rest[5]), axes

    def _groups(self) -> list[tuple[str, list[int]]]:
        """Each distinct frame with the indices of its points."""
        return [(name, [k for k, f in enumerate(self.frames) if f == name]) for name in dict.fromkeys(self.frames)]

    def _point_motions(
        self, q, qd, turns, offsets
    ) -> tuple[list[tuple[int, list[int], BodyMotion]], dict[int, JointAxis]]:
        """For each distinct frame: its body, its points' indices, and the motion of all of them ([K] to a scalar)."""
        groups, offsets = self._groups(), None if offsets is None else jnp.asarray(offsets, q.dtype)
        motions, axes = move_frames(self.robot, (name for name, _ in groups), q, qd, turns)
        found = []
        for (_, k), (body, motion) in zip(groups, motions, strict=True):
            if offsets is not None:
                own = offsets if len(groups) == 1 else offsets[np.array(k)]
                motion = carry(motion, rotate(motion.rotation, (own[:, 0], own[:, 1], own[:, 2])))
            found.append((body, k, motion))
        return found, axes

    def _ordered(self, joined: jax.Array) -> jax.Array:
        """What is joined from the frames' groups, in the points' order."""
        order = [k for _, points in self._groups() for k in points]
        return joined if order == sorted(order) else joined[np.argsort(order)]
