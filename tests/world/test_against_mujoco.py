"""Distances between geometries, against MuJoCo's mj_geomDistance.

Its solver for convex pairs stops at a tolerance; it is set to 1e-12 here, with 200 iterations. For planes, which
mj_geomDistance does not take, the distance is by hand.
"""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxrmp import Affine, pytree
from jaxrmp.world import Boxes, CapsuleDistances, Capsules, Cylinders, HalfSpaces, ObstacleDistances, Spheres, World

from .conftest import random_poses

pytestmark = pytest.mark.usefixtures("x64")
PAIRS = 1000
GEOM = mujoco.mjtGeom
KINDS = ["sphere", "capsule", "box", "cylinder"]


def oracle(robot_kind, kind, robot_sizes, robot_poses, sizes, poses):
    """mj_geomDistance of each pair."""
    spec = mujoco.MjSpec()
    spec.option.ccd_tolerance = 1e-12
    spec.option.ccd_iterations = 200
    for name in ("a", "b"):
        body = spec.worldbody.add_body(name=name)
        body.add_geom(name=name, type=GEOM.mjGEOM_SPHERE, size=[1, 1, 1])
    m = spec.compile()
    d = mujoco.MjData(m)
    found = np.zeros(len(poses))
    for i in range(len(poses)):
        for g, (geom_kind, size, T) in enumerate(
            [(robot_kind, robot_sizes[i], robot_poses[i]), (kind, sizes[i], poses[i])]
        ):
            m.geom_type[g] = getattr(GEOM, f"mjGEOM_{geom_kind.upper()}")
            m.geom_size[g] = size
            m.geom_rbound[g] = 10
            d.geom_xpos[g], d.geom_xmat[g] = T[:3, 3], T[:3, :3].ravel()
        found[i] = mujoco.mj_geomDistance(m, d, 0, 1, 20.0, None)
    return found


def obstacle(kind, sizes, poses):
    """One obstacle of ours per pair, with the name of its kind in a world."""
    axis = poses[:, :3, 2] * sizes[:, 1:2]
    center = poses[:, :3, 3]
    return {
        "sphere": ("spheres", Spheres(center, sizes[:, 0])),
        "capsule": ("capsules", Capsules(center - axis, center + axis, sizes[:, 0])),
        "box": ("boxes", Boxes(poses, sizes)),
        "cylinder": ("cylinders", Cylinders(poses, sizes[:, 0], sizes[:, 1])),
        "plane": ("half_spaces", HalfSpaces(poses[:, :3, 2], np.sum(poses[:, :3, 2] * center, axis=1))),
    }[kind]


def pairs(seed):
    rng = np.random.default_rng(seed)
    return [part for _ in range(2) for part in (rng.uniform(0.03, 0.4, (PAIRS, 3)), random_poses(rng, PAIRS, 0.7))]


@jax.jit
@jax.vmap
def capsule_distance(world, start, end, radius):
    still = jnp.zeros((3, 1))
    return CapsuleDistances(Points(still, start), Points(still, end), world, radius)(jnp.zeros(1))[0]


@jax.jit
@jax.vmap
def sphere_distance(world, center, radius):
    return ObstacleDistances(Points(jnp.zeros((3, 1)), center), world, radius)(jnp.zeros(1))[0]


@pytree
class Points(Affine):
    """One point [1, 3], affine in x."""

    def __call__(self, x):
        return super().__call__(x)[None]


@pytest.mark.parametrize("kind", [*KINDS, "plane"])
@pytest.mark.parametrize("robot_kind", ["sphere", "capsule"])
def test_distances_are_those_of_mujoco(robot_kind, kind):
    robot_sizes, robot_poses, sizes, poses = pairs(KINDS.index(kind) if kind in KINDS else 9)
    center = robot_poses[:, :3, 3]
    axis = robot_poses[:, :3, 2] * robot_sizes[:, 1:2]
    name, obstacles = obstacle(kind, sizes, poses)
    worlds = jax.vmap(lambda o: World(**{name: o}))(jax.tree.map(lambda a: jnp.asarray(a)[:, None], obstacles))
    radius = jnp.asarray(robot_sizes[:, 0])
    if robot_kind == "sphere":
        ours = sphere_distance(worlds, jnp.asarray(center), radius)
    else:
        ours = capsule_distance(worlds, jnp.asarray(center - axis), jnp.asarray(center + axis), radius)
    if kind == "plane":
        normal = poses[:, :3, 2]
        ends = [center] if robot_kind == "sphere" else [center - axis, center + axis]
        theirs = np.min([np.sum(normal * (e - poses[:, :3, 3]), axis=1) for e in ends], axis=0) - robot_sizes[:, 0]
    else:
        theirs = oracle(robot_kind, kind, robot_sizes, robot_poses, sizes, poses)
    outside = np.asarray(ours) > 0
    assert outside.sum() >= PAIRS / 4
    np.testing.assert_allclose(np.asarray(ours)[outside], theirs[outside], atol=1e-6)
    # In contact the two measure different depths; of those that MuJoCo calls free, sampling settles one pair for us.
    assert (theirs[~outside] > 1e-6).sum() <= 1
