"""The task map from joint positions to points on the robot."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ShapeError
from .._forms import NaturalForm
from .._materialise import materialise
from .._pytree import pytree, set_field, static
from .._task_map import Pushforward, TaskMap, Transport
from ._forward import configuration
from ._motion import BodyMotion, JointAxis, attach, carry, move
from ._robot import KinematicModel, Robot
from ._scalars import ZERO, Vector, add3, cross, mul, rotate, scale, sub3


@pytree
class ControlPoints(TaskMap):
    """Where K points fixed to the robot are in the world: `y_k = T_world_frame_k(q) offset_k`.

    **Arguments**: `robot`; `frames`, the K frames that the points are fixed to (one name stands for K equal ones);
    `offsets` [K, 3], the points in their frames, m, a parameter; by default the frames' origins.
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
        offsets: Any = np.zeros((len(frames), 3)) if self.offsets is None else self.offsets
        if not isinstance(offsets, jax.Array):
            offsets = np.asarray(offsets, dtype=float)
        if offsets.ndim == 2 and not several:
            frames *= offsets.shape[0]
        if offsets.shape != (len(frames), 3) or not frames:
            raise ShapeError(f"offsets has shape {offsets.shape}, expected ({len(frames)}, 3): one row per frame.")
        set_field(self, "frames", frames)
        set_field(self, "offsets", offsets)

    def __call__(self, x):
        x = configuration(self.robot, x)
        motions, _ = self._point_motions(x, None)
        return self._in_order([rows(motion.position, (len(k),), x.dtype) for _, k, motion in motions])

    def pushforward(self, x, xd):
        x, xd = configuration(self.robot, x), configuration(self.robot, xd, "xd")
        n = self.robot.num_joints
        motions, axes = self._point_motions(x, xd)
        groups = []
        for body, k, motion in motions:
            columns = jacobian_columns(self.robot.model, body, motion.position, axes, n, x.dtype)
            shapes = ((len(k),), (len(k),), (len(k), n), (len(k),))
            entries = (motion.position, motion.velocity, columns, motion.acceleration)
            groups.append([rows(v, shape, x.dtype) for v, shape in zip(entries, shapes, strict=True)])
        return Pushforward(*(self._in_order(column) for column in zip(*groups, strict=True)))

    def transport(self, x, xd):
        x, xd = configuration(self.robot, x), configuration(self.robot, xd, "xd")
        motions, axes = self._point_motions(x, xd)
        bodies = [0] * len(self.frames)
        groups = []
        for body, k, motion in motions:
            for i in k:
                bodies[i] = body
            entries = (motion.position, motion.velocity, motion.acceleration)
            groups.append([rows(v, (len(k),), x.dtype) for v in entries])
        y, yd, c = (self._in_order(column) for column in zip(*groups, strict=True))

        def pull(form):
            form, at = form.dense(), [materialise(y[:, i]) for i in range(3)]
            M = [[materialise(form.M[:, i, j]) for j in range(3)] for i in range(3)]
            f = [form.f[:, i] - sum(M[i][j] * c[:, j] for j in range(3)) for i in range(3)]
            J = jacobian_rows(self.robot.model, bodies, (at[0], at[1], at[2]), axes, x.dtype)
            MJ = [jnp.asarray(sum(M[i][j] * J[j] for j in range(3))) for i in range(3)]
            parts = [NaturalForm(J[i] @ f[i], J[i] @ MJ[i].T) for i in range(3)]
            return parts[0] + parts[1] + parts[2]

        return Transport(y, yd, pull)

    def _groups(self) -> list[tuple[str, list[int]]]:
        """Each distinct frame with the indices of its points."""
        return [(name, [k for k, f in enumerate(self.frames) if f == name]) for name in dict.fromkeys(self.frames)]

    def _point_motions(self, q, qd) -> tuple[list[tuple[int, list[int], BodyMotion]], dict[int, JointAxis]]:
        """For each distinct frame: its body, its points' indices, and the motion of all of them ([K] to a scalar)."""
        model, offsets = self.robot.model, jnp.asarray(self.offsets, q.dtype)
        frames = [(model.frames[self.robot.frame_index(name)], k) for name, k in self._groups()]
        motions, axes = move(model, (frame.body for frame, _ in frames), q, qd)
        found = []
        for frame, k in frames:
            own = offsets if len(frames) == 1 else offsets[np.array(k)]
            pose = attach(motions[frame.body], frame.position, frame.rotation)
            found.append((frame.body, k, carry(pose, rotate(pose.rotation, (own[:, 0], own[:, 1], own[:, 2])))))
        return found, axes

    def _in_order(self, groups: Sequence[jax.Array]) -> jax.Array:
        if len(groups) == 1:
            return groups[0]
        order = [k for _, points in self._groups() for k in points]
        joined = jnp.concatenate(groups)
        return joined if order == sorted(order) else joined[np.argsort(order)]


def jacobian_rows(
    model: KinematicModel, bodies: Sequence[int], position: Vector, axes: dict[int, JointAxis], dtype: Any
) -> Vector:
    """The transposed rows of the Jacobian of K points at `position` (entries [K]) on `bodies`: three arrays [n, K].

    As `jacobian_columns`, for points on different bodies at once and with the longer axis last.
    """
    joints = [i for i in axes if model.joints[i].coordinate >= 0]
    if not joints:
        still = jnp.zeros((len(model.joint_names), len(bodies)), dtype)
        return still, still, still
    above = [{i for b in model.path(body) for i in model.joints_of_body[b]} for body in bodies]
    moved = np.array([[i in found for found in above] for i in joints], dtype).reshape(len(joints), len(bodies))
    along = [scale(model.joints[i].multiplier, axes[i].direction) for i in joints]
    turns = [model.joints[i].kind == "revolute" for i in joints]
    directions = _entries([v if turn else ZERO for v, turn in zip(along, turns, strict=True)], dtype)
    slides = _entries([ZERO if turn else v for v, turn in zip(along, turns, strict=True)], dtype)
    anchors = _entries([axes[i].anchor for i in joints], dtype)
    directions, slides, anchors = (
        tuple(v if isinstance(v, float) else v[:, None] for v in vector) for vector in (directions, slides, anchors)
    )
    entries = (mul(moved, v) for v in add3(cross(directions, sub3(position, anchors)), slides))
    # A planar arm has a row that is the number zero.
    x, y, z = (jnp.broadcast_to(jnp.asarray(v, dtype), moved.shape) for v in entries)
    of_coordinate = [model.joints[i].coordinate for i in joints]
    n = len(model.joint_names)
    if of_coordinate == list(range(n)):
        return x, y, z
    # Joints that share a coordinate add up, and a coordinate without a joint above the points has none.
    sums = np.array([[c == i for c in of_coordinate] for i in range(n)], dtype).reshape(n, len(joints))
    return sums @ x, sums @ y, sums @ z


def jacobian_columns(
    model: KinematicModel, body: int, position: Vector, axes: dict[int, JointAxis], n: int, dtype: Any
) -> Vector:
    """The three rows of the Jacobian of K points at `position` (entries [K]) on `body`: three arrays [K, n]."""
    movers: list[list[int]] = [[] for _ in range(n)]  # the joints above the body that each coordinate moves
    for i in (i for b in model.path(body) for i in model.joints_of_body[b]):
        if model.joints[i].coordinate >= 0:
            movers[model.joints[i].coordinate].append(i)
    point = (position[0][:, None], position[1][:, None], position[2][:, None])
    columns = ZERO
    for turn in range(max((len(joints) for joints in movers), default=0)):  # more than one turn for mimic joints only
        directions, anchors, slides = [], [], []
        for joints in movers:
            direction, anchor, slide = ZERO, ZERO, ZERO
            if turn < len(joints):
                joint, axis = model.joints[joints[turn]], axes[joints[turn]]
                along = scale(joint.multiplier, axis.direction)
                if joint.kind == "revolute":
                    direction, anchor = along, axis.anchor
                else:
                    slide = along
            directions.append(direction)
            anchors.append(anchor)
            slides.append(slide)
        arms = sub3(point, _entries(anchors, dtype))
        columns = add3(columns, add3(cross(_entries(directions, dtype), arms), _entries(slides, dtype)))
    return columns


def _entries(vectors: list[Vector], dtype: Any) -> Vector:
    """Vectors as one vector of arrays, component by component; a component that is zero throughout stays a float."""
    columns = list(zip(*vectors, strict=True))
    known = [all(isinstance(v, float) and v == 0.0 for v in column) for column in columns]
    x, y, z = (
        0.0 if zero else jnp.stack([jnp.asarray(v, dtype) for v in column])
        for zero, column in zip(known, columns, strict=True)
    )
    return x, y, z


def rows(vector: Vector, shape: tuple[int, ...], dtype: Any) -> jax.Array:
    """Three components of `shape` [K, ...] as one array [K, 3, ...]."""
    return jnp.stack([jnp.broadcast_to(jnp.asarray(v, dtype), shape) for v in vector], axis=1)
