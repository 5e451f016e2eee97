"""Random obstacles and robots for the tests of the world."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp.world import Boxes, Capsules, Cylinders, HalfSpaces, SignedDistanceGrid, Spheres, World


@pytest.fixture
def x64():
    with jax.enable_x64(True):
        yield


def random_poses(rng, n, reach=1.0):
    Q = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Q * np.sign(np.linalg.det(Q))[:, None, None]
    T[:, :3, 3] = rng.uniform(-reach, reach, (n, 3))
    return T


def random_kinds(rng, n):
    """n obstacles of each padded kind, by name."""
    return {
        "spheres": Spheres(rng.uniform(-1, 1, (n, 3)), rng.uniform(0.05, 0.4, n)),
        "capsules": Capsules(rng.uniform(-1, 1, (n, 3)), rng.uniform(-1, 1, (n, 3)), rng.uniform(0.05, 0.3, n)),
        "boxes": Boxes(random_poses(rng, n), rng.uniform(0.05, 0.4, (n, 3))),
        "cylinders": Cylinders(random_poses(rng, n), rng.uniform(0.05, 0.4, n), rng.uniform(0.05, 0.4, n)),
        "half_spaces": HalfSpaces(rng.normal(size=(n, 3)), rng.uniform(-0.5, 0.5, n)),
    }


def sphere_grid(center, radius, half=0.5, n=21, **options):
    """The analytic sphere on a grid of n^3 points that reaches `half` to each side of its centre."""
    axis = np.linspace(-half, half, n)
    at = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    values = np.linalg.norm(at, axis=-1) - radius
    return SignedDistanceGrid(values, np.asarray(center) - half, axis[1] - axis[0], **options)


def random_world(seed, n=2, grid=True):
    rng = np.random.default_rng(seed)
    grids = (sphere_grid(rng.uniform(-0.3, 0.3, 3), 0.2, n=9),) if grid else ()
    return World(**random_kinds(rng, n), grids=grids)


def moving_points(seed, count=5):
    """Points [count, 3] that move along curves as x [7] changes, much cheaper to compile than a robot."""
    rng = np.random.default_rng(seed)
    weights, base = rng.normal(size=(count, 3, 7)) / 4, rng.uniform(-0.8, 0.8, (count, 3))
    return Partial(_curves, jnp.asarray(weights), jnp.asarray(base))


def _curves(weights, base, x):
    return base.astype(x.dtype) + jnp.sin(weights.astype(x.dtype) @ x)


def random_state(seed):
    rng = np.random.default_rng(seed)
    return jnp.asarray(rng.normal(size=7)), jnp.asarray(rng.normal(size=7))
