"""The Jacobian of a frame's twist."""

import jax
import jax.numpy as jnp

from ._forward import configuration
from ._motion import attach, move
from ._robot import Robot
from ._scalars import ZERO, Vector, add3, cross, scale, sub3


def geometric_jacobian(robot: Robot, q: jax.Array, frame: str) -> jax.Array:
    """The geometric Jacobian of one frame: `[v; omega] = J qd`, both in the world's axes, v of the frame's origin.

    **Arguments**: `q`, joint positions [n], rad or m; `frame`, the name of a body or site.
    **Returns** `J` [6, n], the linear rows first; differentiable, in `q`'s dtype.
    **Raises** `UnknownNameError` if there is no such frame, `ShapeError` if `q` is not [n].

    >>> from jaxrmp.kinematics import panda
    >>> J = geometric_jacobian(panda(), jnp.zeros(7), "panda_hand")
    >>> J.shape, J[3:, 0].tolist()
    ((6, 7), [0.0, 0.0, 1.0])

    Siciliano et al., Robotics: Modelling, Planning and Control, section 3.1.
    """
    q = configuration(robot, q)
    model = robot.model
    place = model.frames[robot.frame_index(frame)]
    motions, axes = move(model, (place.body,), q)
    origin = attach(motions[place.body], place.position, place.rotation).position
    columns: list[tuple[Vector, Vector]] = [(ZERO, ZERO)] * robot.num_joints
    for i, axis in axes.items():
        joint = model.joints[i]
        if joint.coordinate < 0:
            continue
        along = scale(joint.multiplier, axis.direction)
        if joint.kind == "revolute":
            twist = cross(along, sub3(origin, axis.anchor)), along
        else:
            twist = along, ZERO
        linear, angular = columns[joint.coordinate]
        columns[joint.coordinate] = add3(linear, twist[0]), add3(angular, twist[1])
    entries = [vectors[part][k] for part in (0, 1) for k in range(3) for vectors in columns]
    return jnp.stack([jnp.asarray(entry, q.dtype) for entry in entries]).reshape(6, robot.num_joints)
