"""Inverse kinematics along paths of poses: damped least squares, each sample from the one before."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import cholesky_solve, length, matmul
from .._rotations import quaternion_of_rotation
from ..kinematics import Robot, forward_kinematics, geometric_jacobian

_FIRST, _NEXT = 400, 8  # steps to the first sample, and from each to the next
_LEVER = 0.2  # m/rad: what a turn counts for beside a position
_STEP = 0.1  # m, the largest way of the hand in a step
_DAMPING = 2e-3  # m/rad, so that near a singularity joints stay where they are
_PULL = 0.05  # of the way to the middle of the joints' ranges, a step, where it does not move the hand
_MARGIN = 0.03  # rad or m that joints keep from their limits
_FAR, _TURNED = 1e-3, np.deg2rad(0.5)  # m and rad that the hand may be off a pose


class Followed(NamedTuple):
    """Joints `q` [N, T, n] along N paths; how far the hand is from each pose, `position` [N, T], m, and `turn` [N, T],
    rad."""

    q: np.ndarray
    position: np.ndarray
    turn: np.ndarray

    @property
    def arrives(self) -> np.ndarray:
        """Whether the hand is within 1 mm and half a degree of each pose, [N, T]."""
        return (self.position <= _FAR) & (self.turn <= _TURNED)


def follow_poses(robot: Robot, frame: str, poses: np.ndarray, start: np.ndarray) -> Followed:
    """The joints that take `frame` of `robot` along `poses` [N, T, 4, 4], in the world of its model, from `start`, [n]
    for all or [N, n].

    Newton's steps by damped least squares, where what does not move the hand leads to the middle of the joints' ranges.
    A joint that would leave its range stays, and the others do without it. The first sample of each path is sought from
    `start`, each other from the one before.

    Siciliano et al., Robotics: Modelling, Planning and Control, section 3.7.
    """
    with jax.enable_x64(True):
        starts = jnp.broadcast_to(jnp.asarray(start, float), (len(poses), robot.num_joints))
        found = _follow(robot, jnp.asarray(poses), starts, frame=frame)
        return Followed(*map(np.asarray, found))


@partial(jax.jit, static_argnames="frame")
def _follow(robot: Robot, poses: jax.Array, starts: jax.Array, *, frame: str):
    lower, upper = (jnp.asarray(limit, starts.dtype) for limit in (robot.lower, robot.upper))
    limited = jnp.isfinite(upper - lower)
    margin = jnp.where(upper - lower > 4 * _MARGIN, _MARGIN, 0.0)
    lower, upper = lower + margin, upper - margin
    middle = jnp.where(limited, (lower + upper) / 2, 0.0)
    scale = jnp.array([1.0] * 3 + [_LEVER] * 3)

    def miss(q, T):
        at = forward_kinematics(robot, q, frame)
        wxyz = quaternion_of_rotation(matmul(T[:3, :3], at[:3, :3].T))
        return jnp.concatenate([T[:3, 3] - at[:3, 3], 2 * jnp.sign(wxyz[0] + 1e-12) * wxyz[1:]])

    def step(q, T):
        e = scale * miss(q, T)
        e = e * jnp.minimum(1.0, _STEP / jnp.maximum(length(e), 1e-12))
        J = scale[:, None] * geometric_jacobian(robot, q, frame)
        pull = _PULL * jnp.where(limited, middle - q, 0.0)
        free = jnp.ones_like(q)
        change = jnp.zeros_like(q)
        for _ in range(3):  # joints at a limit, and those that get there since they stay
            K, z = J * free, pull * free
            A = matmul(K, K.T) + _DAMPING**2 * jnp.eye(6)
            change = z + matmul(K.T, cholesky_solve(A, e - matmul(K, z)))
            free = jnp.where((q + change < lower) | (q + change > upper), 0.0, free)
        return jnp.clip(q + change, lower, upper)

    def to(q, T, steps):
        return jax.lax.fori_loop(0, steps, lambda _, q: step(q, T), q)

    def one(T, start):
        def follow(q, T):
            q = to(q, T, _NEXT)
            e = miss(q, T)
            return q, (q, length(e[:3]), 2 * jnp.arcsin(jnp.minimum(length(e[3:]) / 2, 1.0)))

        return jax.lax.scan(follow, to(jnp.clip(start, lower, upper), T[0], _FIRST), T)[1]

    return jax.vmap(one)(poses, starts)
