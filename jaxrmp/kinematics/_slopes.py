"""Derivatives of a robot's motion from where its joints' axes are, not back through every operation of the chain.

They are a few dozen operations on arrays, where the scalars of the chain make thousands, which take a compiler longer
than all else in a policy.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import matmul
from ._robot import KinematicModel
from ._screws import Layout, Places, cross, layout, place_changes, rates, swept

Turns = dict[int, tuple[Any, Any]]
"""Cosine and sine of each revolute joint's displacement, by the joint's index."""


def with_slopes(
    chain: Callable[..., Any], known: Any, slopes: Callable[..., Any], q: Any, qd: Any, turns: Turns, *others: Any
) -> Any:
    """What `chain(q, qd, turns, *others)` gives, with derivatives by `slopes`.

    **Arguments**: `known`, the chain's result, where a number is a float if it is known beforehand, as it then is in
    the result; all else there are arrays; last in it are the joints' axes; `slopes`, of all arguments and of the
    changes of `q`, `qd` and `others`, to the result and its change, both as lists of leaves; `turns`, those at `q`,
    whose changes are not asked for.
    """
    if not known[-1]:  # no joint moves any of it
        return chain(q, qd, turns, *others)
    q = jnp.asarray(q)
    leaves, structure = jax.tree.flatten(known)
    found = [k for k, leaf in enumerate(leaves) if not isinstance(leaf, float)]
    locked = {i: turn for i, turn in turns.items() if isinstance(turn[0], float)}

    def arrays_of(entries: list[Any]) -> list[jax.Array]:
        return [jnp.asarray(entries[k], q.dtype) for k in found]

    @jax.custom_jvp
    def carried(q, qd, turning, *others):
        return arrays_of(jax.tree.leaves(chain(q, qd, locked | turning, *others)))

    @carried.defjvp
    def push(primals, tangents):
        (q, qd, turning, *others), (dq, dqd, _, *changes) = primals, tangents
        result, change = slopes((q, qd, locked | turning, *others), (dq, dqd, *changes))
        return arrays_of(result), arrays_of(change)

    given = iter(carried(q, qd, {i: turn for i, turn in turns.items() if i not in locked}, *others))
    return jax.tree.unflatten(structure, [leaf if isinstance(leaf, float) else next(given) for leaf in leaves])


def slopes_of_bodies(model: KinematicModel, at_rest: Callable[..., Any], arguments: Any, changes: Any) -> Any:
    """Motions of bodies and axes of joints, and their changes; `at_rest(q, turns)` gives them without velocities."""
    (q, qd, turns), (dq, dqd) = arguments, changes
    motions, axes = at_rest(q, turns=turns)
    of = layout(model, sorted(axes), sorted(motions), q.dtype)
    places, rotations = _places(motions, axes, q.dtype)
    sweep = swept(of, places, matmul(of.rates, dq))
    slopes = place_changes(sweep, places)
    turned = jnp.stack([cross(sweep.omega, rotations[:, k]) for k in range(3)], axis=1)
    if qd is None:
        still = (jnp.zeros_like(places.origins),) * 4
        return jax.tree.leaves((motions, axes)), _entries(turned, slopes, still)
    found, moved = _moving(of, places, slopes, qd, dqd)
    return _entries(rotations, places, found), _entries(turned, slopes, moved)


def slopes_of_points(
    model: KinematicModel, at_rest: Callable[..., Any], bodies: Sequence[int], arguments: Any, changes: Any
) -> Any:
    """Positions, velocities and accelerations of K points, components [K], and axes of joints, and their changes.

    The points are at `offsets` [3, K] from the origins of `bodies`, the last of the arguments; `at_rest` as above.
    """
    (q, qd, turns, offsets), (dq, dqd, doffsets) = arguments, changes
    motions, axes = at_rest(q, turns=turns)
    of = layout(model, sorted(axes), bodies, q.dtype)
    origins, rotations = _places(motions, axes, q.dtype)
    of_points = np.array([[b == body for body in bodies] for b in sorted(motions)], q.dtype)
    R = matmul(rotations.reshape(9, -1), of_points).reshape(3, 3, -1)
    places = origins._replace(origins=matmul(origins.origins, of_points) + jnp.sum(R * offsets, axis=1))
    slopes = place_changes(swept(of, places, matmul(of.rates, dq)), places)
    slopes = slopes._replace(origins=slopes.origins + jnp.sum(R * doffsets, axis=1))
    (_, _, *found), (_, _, *moved) = _moving(of, places, slopes, qd, dqd)
    return (
        [*_rows(places.origins, *found), *jax.tree.leaves(axes)],
        [*_rows(slopes.origins, *moved), *_numbers(jnp.concatenate(slopes[:2]))],
    )


def _moving(of: Layout, places: Places, slopes: Places, qd: jax.Array, dqd: jax.Array) -> Any:
    """`rates` at `places`, and how they change as these do."""
    return jax.jvp(partial(rates, of), (places, matmul(of.rates, qd)), (slopes, matmul(of.rates, dqd)))


def _places(motions: dict[int, Any], axes: dict[int, Any], dtype: Any) -> tuple[Places, jax.Array]:
    """The places of bodies and joints, and the bodies' rotations, by rows and columns [3, 3, B]."""

    def columns(vectors: list[Any]) -> jax.Array:
        entries = [jnp.asarray(entry, dtype) for vector in vectors for entry in vector]
        return jnp.stack(entries).reshape(len(vectors), -1).T

    bodies, joints = [motions[b] for b in sorted(motions)], [axes[i] for i in sorted(axes)]
    places = Places(
        columns([axis.direction for axis in joints]),
        columns([axis.anchor for axis in joints]),
        columns([motion.position for motion in bodies]),
    )
    return places, columns([motion.rotation for motion in bodies]).reshape(3, 3, -1)


def _entries(rotations: jax.Array, places: Places, rates: Sequence[jax.Array]) -> list[jax.Array]:
    """All numbers of motions and axes, in the order of their leaves."""
    bodies = jnp.concatenate([rotations.reshape(9, -1), places.origins, *rates])
    return [*_numbers(bodies), *_numbers(jnp.concatenate(places[:2]))]


def _numbers(columns: jax.Array) -> list[jax.Array]:
    flat = columns.T.reshape(-1)
    return [one.reshape(()) for one in jax.lax.split(flat, [1] * flat.size)]


def _rows(*vectors: jax.Array) -> list[jax.Array]:
    return [row for vector in vectors for row in jnp.unstack(vector)]
