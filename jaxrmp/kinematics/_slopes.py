"""Derivatives of a motion from where the joints' axes are, instead of back through every operation of the chain.

A joint moves all that is below it about its axis as a rigid body. So the derivative of a pose is a sum over the joints
above, and velocities and accelerations are such sums themselves: a few dozen operations on arrays of all joints and
bodies, where the scalars of the chain make thousands, which take a compiler longer than all else in a policy.

Featherstone, Rigid Body Dynamics Algorithms, chapters 2 and 4.
"""

import functools
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import matmul
from . import _scalars
from ._robot import KinematicModel

Chain = Callable[[Any, Any, dict[int, Any]], Any]
"""`(q, qd, turns)` to the motions of bodies and the axes of the joints above them, each by index."""


class _Layout(NamedTuple):
    """The J joints and B bodies of a motion in the order of their indices, and which of them are above which."""

    above_joints: np.ndarray  # [J, J], 1 where the first is above the second
    above_bodies: np.ndarray  # [J, B]
    turning: np.ndarray  # [J], 1 for a joint that turns, 0 for one that slides
    rates: np.ndarray  # [J, n], what the joints' rates are of the coordinates'


class _Places(NamedTuple):
    """In the world, component by component: axes of joints [3, J], rows of rotations [9, B], origins of bodies [3, B]."""

    directions: jax.Array
    anchors: jax.Array
    rotations: jax.Array
    origins: jax.Array


def with_slopes(
    model: KinematicModel, chain: Chain, known: Callable[[bool], Any], q: Any, qd: Any, turns: dict[int, Any]
) -> Any:
    """What `chain` gives of `q` and `qd`, both [n] or `qd` None, and how it changes with them.

    **Arguments**: `known`, for a motion with velocities or without, the chain's result, in which every number is a
    float if it is known beforehand, as it then is in the result; `turns`, those at `q`, which add nothing to slopes.
    """
    q = jnp.asarray(q)
    leaves, structure = jax.tree.flatten(known(qd is not None))
    found = [k for k, leaf in enumerate(leaves) if not isinstance(leaf, float)]
    fixed = {i: turn for i, turn in turns.items() if isinstance(turn[0], float)}

    def computed(entries: list[Any]) -> list[jax.Array]:
        return [jnp.asarray(entries[k], q.dtype) for k in found]

    @jax.custom_jvp
    def carried(q, qd, turning):
        return computed(jax.tree.leaves(chain(q, qd, fixed | turning)))

    @carried.defjvp
    def push(primals, tangents):
        (q, qd, turning), (dq, dqd, _) = primals, tangents
        motions, axes = with_slopes(model, chain, known, q, None, fixed | turning)
        layout = _layout(model, tuple(sorted(motions)), tuple(sorted(axes)))
        places = _places(motions, axes, q.dtype)
        slopes = _slopes(layout, places, matmul(layout.rates, dq))
        at_rest = jnp.zeros((12, len(motions)), q.dtype)
        if qd is None:
            return computed(jax.tree.leaves((motions, axes))), computed(_entries(slopes, at_rest))
        qd, dqd = matmul(layout.rates, qd), matmul(layout.rates, dqd)
        rates, changes = jax.jvp(functools.partial(_rates, layout), (places, qd), (slopes, dqd))
        return computed(_entries(places, rates)), computed(_entries(slopes, changes))

    given = iter(carried(q, qd, {i: turn for i, turn in turns.items() if i not in fixed}))
    return jax.tree.unflatten(structure, [leaf if isinstance(leaf, float) else next(given) for leaf in leaves])


@functools.lru_cache(maxsize=64)
def _layout(model: KinematicModel, bodies: tuple[int, ...], joints: tuple[int, ...]) -> _Layout:
    of = [model.joints[i] for i in joints]
    before = {i: above[: above.index(i)] for i in joints for above in [model.joints_above(model.joints[i].body, True)]}
    rates = np.zeros((len(joints), len(model.joint_names)))
    for k, joint in enumerate(of):
        if joint.coordinate >= 0:
            rates[k, joint.coordinate] = joint.multiplier
    return _Layout(
        _ones(joints, (before[i] for i in joints)),
        _ones(joints, (model.joints_above(b, True) for b in bodies)),
        np.array([joint.kind == "revolute" for joint in of], float),
        rates,
    )


def _ones(joints: tuple[int, ...], above: Iterable[list[int]]) -> np.ndarray:
    """[joints, those that they may be above], 1 where they are."""
    columns = [[float(i in found) for i in joints] for found in above]
    return np.array(columns).reshape(-1, len(joints)).T


def _places(motions: dict[int, Any], axes: dict[int, Any], dtype: Any) -> _Places:
    def columns(vectors: list[Any]) -> jax.Array:
        entries = [jnp.asarray(entry, dtype) for vector in vectors for entry in vector]
        return jnp.stack(entries).reshape(len(vectors), -1).T

    bodies, joints = [motions[b] for b in sorted(motions)], [axes[i] for i in sorted(axes)]
    return _Places(
        columns([axis.direction for axis in joints]),
        columns([axis.anchor for axis in joints]),
        columns([motion.rotation for motion in bodies]),
        columns([motion.position for motion in bodies]),
    )


class _Sweep(NamedTuple):
    """What rates of the joints do: `spin` of each by itself, and of all together the angular velocities and velocities
    of what is fixed to the part above each joint, and to each body; all [3, J] or [3, B]."""

    spin: jax.Array
    omega_of_joints: jax.Array
    velocity_of_anchors: jax.Array
    omega_of_bodies: jax.Array
    velocity_of_origins: jax.Array


def _swept(layout: _Layout, places: _Places, rate: jax.Array) -> _Sweep:
    _, anchors, _, origins = places = _near(places)
    moved = places.directions * rate
    spin = moved * layout.turning
    twists = jnp.concatenate([spin, moved - spin - _cross(spin, anchors)])
    of_joints, of_bodies = matmul(twists, layout.above_joints), matmul(twists, layout.above_bodies)
    return _Sweep(
        spin,
        of_joints[:3],
        _cross(of_joints[:3], anchors) + of_joints[3:],
        of_bodies[:3],
        _cross(of_bodies[:3], origins) + of_bodies[3:],
    )


def _near(places: _Places) -> _Places:
    """The same, seen from an anchor, so that a robot far from the world's origin loses no digits."""
    origin = jax.lax.stop_gradient(places.anchors[:, :1])
    return places._replace(anchors=places.anchors - origin, origins=places.origins - origin)


def _slopes(layout: _Layout, places: _Places, rate: jax.Array) -> _Places:
    """How places change while the joints move at a `rate` [J]."""
    sweep = _swept(layout, places, rate)
    columns = [_cross(sweep.omega_of_bodies, places.rotations[k::3]) for k in range(3)]
    return _Places(
        _cross(sweep.omega_of_joints, places.directions),
        sweep.velocity_of_anchors,
        jnp.stack(columns, axis=1).reshape(places.rotations.shape),
        sweep.velocity_of_origins,
    )


def _rates(layout: _Layout, places: _Places, rate: jax.Array) -> jax.Array:
    """Angular velocities, angular accelerations, velocities and accelerations of bodies [12, B], their origins', while
    the joints move at a `rate` [J] that does not change."""
    sweep, (directions, anchors, _, origins) = _swept(layout, places, rate), _near(places)
    changed = _cross(sweep.omega_of_joints, directions * rate)
    turned = changed * layout.turning
    pull = changed - turned - _cross(turned, anchors) - _cross(sweep.spin, sweep.velocity_of_anchors)
    of_bodies = matmul(jnp.concatenate([turned, pull]), layout.above_bodies)
    omega, alpha, velocity = sweep.omega_of_bodies, of_bodies[:3], sweep.velocity_of_origins
    acceleration = _cross(alpha, origins) + _cross(omega, velocity) + of_bodies[3:]
    return jnp.concatenate([omega, alpha, velocity, acceleration])


def _cross(u: jax.Array, v: jax.Array) -> jax.Array:
    """`u x v`, components first."""
    return jnp.stack(_scalars.cross((u[0], u[1], u[2]), (v[0], v[1], v[2])))


def _entries(places: _Places, rates: jax.Array) -> list[jax.Array]:
    """All numbers of a motion, as its pytree has them."""
    bodies = jnp.concatenate([places.rotations, places.origins, rates])
    joints = jnp.concatenate([places.directions, places.anchors])
    whole = jnp.concatenate([bodies.T.reshape(-1), joints.T.reshape(-1)])
    return [one.reshape(()) for one in jax.lax.split(whole, [1] * whole.size)]
