"""One pass from the world down the bodies that matter: poses, and on request velocities and accelerations."""

import functools
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..xla import materialise, one_loop
from ._robot import Joint, KinematicModel, Robot
from ._scalars import (
    IDENTITY,
    ZERO,
    Rotation,
    Scalar,
    Vector,
    add,
    add3,
    axis_rotation,
    cross,
    matmul,
    mul,
    rotate,
    scale,
    sub3,
)
from ._slopes import Turns, slopes_of_bodies, with_slopes


class BodyMotion(NamedTuple):
    """Motion of a body in the world. The accelerations are those at `qdd = 0`: what the velocities alone cause."""

    rotation: Rotation
    position: Vector  # of the body's origin
    omega: Vector = ZERO  # angular velocity
    alpha: Vector = ZERO  # angular acceleration
    velocity: Vector = ZERO  # of the body's origin
    acceleration: Vector = ZERO


class JointAxis(NamedTuple):
    """Where a joint's axis is in the world."""

    direction: Vector
    anchor: Vector


def move(
    model: KinematicModel,
    bodies: Iterable[int],
    q: jax.Array,
    qd: jax.Array | None = None,
    turns: Turns | None = None,
) -> tuple[dict[int, BodyMotion], dict[int, JointAxis]]:
    """Motion of each body in `bodies` and of the bodies above them, and the axis of each joint met, by index.

    Every body is computed once. Without `qd` the velocities and accelerations stay zero and cost nothing; `turns` are
    those at q, if they are known.
    """
    bodies = tuple(sorted(set(bodies)))
    turns = turns_at(model, bodies, q) if turns is None else turns
    slopes = functools.partial(slopes_of_bodies, model, functools.partial(move, model, bodies, qd=None))
    chain = functools.partial(_chain, model, bodies)
    return with_slopes(chain, known_motion(model, bodies, qd is not None), slopes, q, qd, turns)


def _chain(
    model: KinematicModel, bodies: tuple[int, ...], q: Any, qd: Any, turns: Turns
) -> tuple[dict[int, BodyMotion], dict[int, JointAxis]]:
    needed = _with_those_above(model, bodies)
    motions = {0: BodyMotion(IDENTITY, ZERO)}
    axes: dict[int, JointAxis] = {}
    for b in needed:
        body = model.bodies[b]
        motion = attach(motions[body.parent], body.position, body.rotation)
        for i in model.joints_of_body[b]:
            joint = model.joints[i]
            anchor = add3(motion.position, rotate(motion.rotation, joint.anchor))
            axes[i] = JointAxis(rotate(motion.rotation, joint.axis), anchor)
            rate = 0.0 if qd is None or joint.coordinate < 0 else mul(joint.multiplier, _entry(qd, joint.coordinate))
            if joint.kind == "revolute":
                motion = _turn(motion, joint, axes[i], axis_rotation(joint.axis, *turns[i]), rate)
            else:
                slip = scale(rate, axes[i].direction)
                coriolis = scale(2.0, cross(motion.omega, slip))
                motion = carry(motion, scale(_displacement(joint, q), axes[i].direction))
                velocity, acceleration = add3(motion.velocity, slip), add3(motion.acceleration, coriolis)
                motion = motion._replace(velocity=velocity, acceleration=acceleration)
        motions[b] = motion
    return {b: motions[b] for b in bodies}, axes


@functools.lru_cache(maxsize=256)
def known_motion(
    model: KinematicModel, bodies: tuple[int, ...], moving: bool
) -> tuple[dict[int, BodyMotion], dict[int, JointAxis]]:
    """A motion in which every number is a float that is known whatever `q` and `qd` are."""
    one = np.float32(1)  # no float
    turns: Turns = dict.fromkeys(range(len(model.joints)), (one, one))
    turns.update(_locked_turns(model, range(len(model.joints))))
    unknown = np.full(len(model.joint_names), one)
    return _chain(model, bodies, unknown, unknown if moving else None, turns)


def move_frames(
    robot: Robot, frames: Iterable[str], q: jax.Array, qd: jax.Array | None = None, turns: Turns | None = None
) -> tuple[list[tuple[int, BodyMotion]], dict[int, JointAxis]]:
    """Body and motion of each of `frames`, and the axes of the joints above them; the rest as `move`."""
    places = [robot.model.frames[robot.frame_index(name)] for name in frames]
    motions, axes = move(robot.model, (place.body for place in places), q, qd, turns)
    return [(place.body, attach(motions[place.body], place.position, place.rotation)) for place in places], axes


def attach(motion: BodyMotion, position: Vector, rotation: Rotation) -> BodyMotion:
    """Motion of a frame that sits at a fixed pose in a moving body."""
    return carry(motion, rotate(motion.rotation, position))._replace(rotation=matmul(motion.rotation, rotation))


def carry(motion: BodyMotion, arm: Vector) -> BodyMotion:
    """The same rigid motion with its origin moved by `arm`, a world vector that turns with the body."""
    swing = cross(motion.omega, arm)
    pull = add3(cross(motion.alpha, arm), cross(motion.omega, swing))
    return motion._replace(
        position=add3(motion.position, arm),
        velocity=add3(motion.velocity, swing),
        acceleration=add3(motion.acceleration, pull),
    )


def _entry(x: Any, i: int) -> Any:
    return x[i] if isinstance(x, np.ndarray) else jax.lax.index_in_dim(x, i, keepdims=False)


def _displacement(joint: Joint, q: jax.Array) -> Scalar:
    """Joint position less the reference position."""
    if joint.coordinate < 0:
        return joint.offset - joint.reference
    return add(mul(joint.multiplier, _entry(q, joint.coordinate)), joint.offset - joint.reference)


def turns_at(model: KinematicModel, bodies: Iterable[int], q: jax.Array) -> Turns:
    """The turns of the joints of `bodies` and of those above them, all in one array operation."""
    met = [i for b in _with_those_above(model, bodies) for i in model.joints_of_body[b]]
    found = _locked_turns(model, met)
    moving = [i for i in met if model.joints[i].kind == "revolute" and i not in found]
    if moving:
        values = _cosines_and_sines(_displacements([model.joints[i] for i in moving], q))
        found.update((i, (_entry(values, k), _entry(values, k + len(moving)))) for k, i in enumerate(moving))
    return found


def _locked_turns(model: KinematicModel, joints: Iterable[int]) -> Turns:
    """Of those among `joints` that turn about an axis and no coordinate moves."""
    locked = [(i, model.joints[i]) for i in joints if model.joints[i].coordinate < 0]
    angles = {i: joint.offset - joint.reference for i, joint in locked if joint.kind == "revolute"}
    return {i: (math.cos(angle), math.sin(angle)) for i, angle in angles.items()}


@one_loop
def _cosines_and_sines(angles: jax.Array) -> jax.Array:
    return materialise(jnp.concatenate([jnp.cos(angles), jnp.sin(angles)]))


def _with_those_above(model: KinematicModel, bodies: Iterable[int]) -> list[int]:
    return sorted({b for target in bodies for b in model.path(target)})


def _displacements(joints: list[Joint], q: jax.Array) -> jax.Array:
    """As `_displacement`, for several moving joints at once."""
    coordinates = [joint.coordinate for joint in joints]
    first, last = coordinates[0], coordinates[-1]
    if coordinates == list(range(first, last + 1)):
        values = jax.lax.slice_in_dim(q, first, last + 1)
    else:
        values = q[np.array(coordinates)]
    multipliers = np.array([joint.multiplier for joint in joints], q.dtype)
    offsets = np.array([joint.offset - joint.reference for joint in joints], q.dtype)
    if (multipliers != 1.0).any():
        values = values * multipliers
    return values + offsets if offsets.any() else values


def _turn(motion: BodyMotion, joint: Joint, axis: JointAxis, turn: Rotation, rate: Scalar) -> BodyMotion:
    at_anchor = carry(motion, sub3(axis.anchor, motion.position)) if any(joint.anchor) else motion
    spin = scale(rate, axis.direction)
    rotation = matmul(motion.rotation, turn)
    turned = at_anchor._replace(
        rotation=rotation,
        omega=add3(motion.omega, spin),
        alpha=add3(motion.alpha, cross(motion.omega, spin)),
    )
    return carry(turned, scale(-1.0, rotate(rotation, joint.anchor))) if any(joint.anchor) else turned
