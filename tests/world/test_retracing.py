"""One compiled policy serves a world in which everything changes but the number of slots."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import RigidTransform, acceleration, batched, compose, pullback
from jaxrmp.leaves import Attractor, CollisionAvoidance, Damping, JointLimit, Posture
from jaxrmp.world import Boxes, Capsules, Cylinders, HalfSpaces, ObstacleDistances, SelfDistances, Spheres, World

from .conftest import moving_points, random_poses, sphere_grid


def scene():
    T = np.eye(4)
    T[:3, 3] = 0.4, 0.1, 0.9
    return World(
        Spheres.of([((0.6, 0.3, 0.6), 0.1)], capacity=3),
        Capsules.of([((0.0, -1, 0), (0, 1, 0.2), 0.1)], capacity=2),
        Boxes.of([(T, (0.1, 0.1, 0.1))], capacity=2),
        Cylinders.of([(T, 0.1, 0.2)], capacity=2),
        HalfSpaces.of([((0, 0, 1), -1.0)], capacity=2),
        sphere_grid((0.2, 0.2, 0.2), 0.2, n=5),
    )


def policy(world, goals=((0.3, 0.2, 0.5), (0.1, 0.1, 0.4)), T_world_object=None, gain=1.0, rest=0.1, reach=3.0):
    points, pairs = moving_points(0, 2), moving_points(1, 3)
    object_frame = RigidTransform(np.eye(4) if T_world_object is None else T_world_object)
    return (
        pullback(compose(points, object_frame), batched(*(Attractor(np.asarray(goal), gain=gain) for goal in goals)))
        + pullback(ObstacleDistances(points, world, 0.05), CollisionAvoidance(reach=reach, barrier=0.01 * gain))
        + pullback(SelfDistances(pairs, ((0, 1), (0, 2)), 0.02), CollisionAvoidance(reach=reach))
        + JointLimit(np.full(7, -2.0), np.full(7, 2.0 + rest))
        + Posture(np.full(7, rest), stiffness=gain)
        + Damping(0.1, 2.0 * gain)
    )


def changes():
    world, T = scene(), random_poses(np.random.default_rng(0), 3)
    filled = world.spheres.set(1, center=(0.3, 0.2, 0.5), radius=0.2).set(2, center=(0.1, 0.4, 0.2), radius=0.1)
    return {
        "moved sphere": policy(dataclasses.replace(world, spheres=world.spheres.set(0, center=(0.3, 0.1, 0.5)))),
        "moved box": policy(dataclasses.replace(world, boxes=world.boxes.set(0, T_world_box=T[0]))),
        "added spheres": policy(dataclasses.replace(world, spheres=filled)),
        "built anew with more": policy(
            dataclasses.replace(world, cylinders=Cylinders.of([(t, 0.2, 0.3) for t in T[:2]], capacity=2))
        ),
        "disabled capsule": policy(dataclasses.replace(world, capsules=world.capsules.set(0, active=False))),
        "disabled half-space": policy(dataclasses.replace(world, half_spaces=HalfSpaces.of(capacity=2))),
        "grid filled with something else": policy(
            dataclasses.replace(world, grids=(sphere_grid((0.3, 0.2, 0.5), 0.1, n=5),))
        ),
        "disabled grid": policy(
            dataclasses.replace(world, grids=(sphere_grid((0.2, 0.2, 0.2), 0.2, n=5, active=False),))
        ),
        "goals": policy(world, goals=((0.5, -0.2, 0.5), (0.0, 0.3, 0.4))),
        "goals as JAX arrays": policy(world, goals=(jnp.array([0.5, -0.2, 0.4]), jnp.zeros(3))),
        "gains": policy(world, gain=3.0),
        "posture and limits": policy(world, rest=0.4),
        "reach": policy(world, reach=2.0),
        "object pose": policy(world, T_world_object=T[1]),
    }


def test_no_change_of_numbers_retraces_and_each_is_felt():
    traces = []

    @jax.jit
    def qdd(tree, q, qd):
        traces.append(1)
        return acceleration(tree, q, qd)

    q, qd = jnp.full(7, 0.3), jnp.full(7, -0.2)
    before = qdd(policy(scene()), q, qd)
    for name, tree in changes().items():
        after = qdd(tree, q, qd)
        assert np.isfinite(after).all(), name
        assert np.abs(after - before).max() > 1e-4, name
    assert len(traces) == 1
