"""How all bodies of a robot, or points on them, move with its joints: sums over the joints above, as arrays.

A joint moves all that is below it about its axis as one rigid body. Angular velocities and velocities of what is fixed
to a body are thus sums of twists, and so are, by the same sums, the accelerations, and the derivatives of places.
Vectors are arrays with three rows, a column for each joint, body or point.

Featherstone, Rigid Body Dynamics Algorithms, chapters 2 and 4.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import matmul
from . import _scalars
from ._robot import KinematicModel


class Layout(NamedTuple):
    """Of J joints, and B bodies or points fixed to bodies, which joints are above which of them."""

    above_joints: np.ndarray  # [J, J], 1 where the first is above the second
    above: np.ndarray  # [J, B]
    turning: np.ndarray  # [J], 1 for a joint that turns, 0 for one that slides
    rates: np.ndarray  # [J, n], what the joints' rates are of the coordinates'


class Places(NamedTuple):
    """Where the joints' axes are in the world, directions and anchors [3, J], and bodies' origins or points [3, B]."""

    directions: jax.Array
    anchors: jax.Array
    origins: jax.Array


class Sweep(NamedTuple):
    """What rates of the joints do: `spin` of each by itself, [3, J], and of all together the angular velocities and
    velocities of what is above each joint, at its anchor, [3, J], and of each body or point [3, B]."""

    spin: jax.Array
    omega_above: jax.Array
    velocity_above: jax.Array
    omega: jax.Array
    velocity: jax.Array


def layout(model: KinematicModel, joints: Sequence[int], bodies: Sequence[int], dtype: Any) -> Layout:
    """Which of `joints` are above which of them, and of `bodies`, each one or one for every point."""
    above = {b: model.joints_above(b, locked=True) for b in {*bodies, *(model.joints[i].body for i in joints)}}
    own = {i: above[model.joints[i].body] for i in joints}
    rates = np.zeros((len(joints), len(model.joint_names)), dtype)
    for k, i in enumerate(joints):
        if model.joints[i].coordinate >= 0:
            rates[k, model.joints[i].coordinate] = model.joints[i].multiplier
    return Layout(
        np.array([[j in own[i][: own[i].index(i)] for i in joints] for j in joints], dtype),
        np.array([[j in above[b] for b in bodies] for j in joints], dtype),
        np.array([model.joints[i].kind == "revolute" for i in joints], dtype),
        rates,
    )


def swept(layout: Layout, places: Places, rate: jax.Array) -> Sweep:
    """The motion of all while the joints move at a `rate` [J]."""
    directions, anchors, origins = _near(places)
    moved = directions * rate
    spin = moved * layout.turning
    twists = jnp.concatenate([spin, moved - spin - cross(spin, anchors)])
    omega_above, moment_above = jnp.split(matmul(twists, layout.above_joints), 2)
    omega, moment = jnp.split(matmul(twists, layout.above), 2)
    return Sweep(spin, omega_above, cross(omega_above, anchors) + moment_above, omega, cross(omega, origins) + moment)


def place_changes(sweep: Sweep, places: Places) -> Places:
    """How places change in a motion."""
    return Places(cross(sweep.omega_above, places.directions), sweep.velocity_above, sweep.velocity)


def rates(layout: Layout, places: Places, rate: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Angular velocities and accelerations, velocities and accelerations of bodies or points, all [3, B], while the
    joints move at a `rate` [J] that does not change."""
    sweep, (directions, anchors, origins) = swept(layout, places, rate), _near(places)
    changed = cross(sweep.omega_above, directions * rate)
    turned = changed * layout.turning
    pulls = changed - turned - cross(turned, anchors) - cross(sweep.spin, sweep.velocity_above)
    alpha, pull = jnp.split(matmul(jnp.concatenate([turned, pulls]), layout.above), 2)
    return sweep.omega, alpha, sweep.velocity, cross(alpha, origins) + cross(sweep.omega, sweep.velocity) + pull


def cross(u: jax.Array, v: jax.Array) -> jax.Array:
    """`u x v`, column by column."""
    a, b, c = jnp.unstack(u)
    x, y, z = jnp.unstack(v)
    return jnp.stack(_scalars.cross((a, b, c), (x, y, z)))


def _near(places: Places) -> Places:
    """The same, seen from an anchor, so that far from the world's origin no digits are lost."""
    origin = jax.lax.stop_gradient(places.anchors[:, :1])
    return places._replace(anchors=places.anchors - origin, origins=places.origins - origin)
