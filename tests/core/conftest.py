"""Random nonlinear maps and random geometric dynamical systems for the laws of the core."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import GeometricDynamicalSystem


@pytest.fixture
def x64():
    with jax.enable_x64(True):
        yield


def tanh_map(W, V, b, x):
    return V @ jnp.tanh(W @ x + b)


def cubic_map(A, x):
    return A @ x + 0.1 * jnp.sin(A @ x) ** 3


def warped_metric(A, v, speed, x, xd):
    m = x.shape[0]
    L = jnp.eye(m) + 0.3 * jnp.tril(jnp.sin(jnp.reshape(A @ x, (m, m))))
    return L @ L.T * (1 + speed * jnp.tanh(v @ xd) ** 2)


def log_cosh_potential(center, x):
    return jnp.sum(jnp.logaddexp(x - center, center - x))


def constant_damping(B, x, xd):
    return B * (1 + jnp.sum(x * x))


@pytest.fixture
def random_map():
    """A smooth nonlinear map R^n -> R^m as a function of seed and sizes."""

    def make(seed, n, m):
        rng = np.random.default_rng(seed)
        W, V, b = rng.normal(size=(6, n)), rng.normal(size=(m, 6)), rng.normal(size=6)
        return Partial(tanh_map, *(jnp.asarray(a) for a in (W / 2, V / 2, b)))

    return make


@pytest.fixture
def random_diffeomorphism():
    """An invertible smooth map of R^n: a well-conditioned linear map plus a bounded warp of small slope."""

    def make(seed, n):
        A = np.eye(n) + 0.3 * np.random.default_rng(seed).uniform(-1, 1, (n, n)) / n
        return Partial(cubic_map, jnp.asarray(A))

    return make


@pytest.fixture
def random_gds():
    """A GDS on R^m with a position-dependent metric; `speed` > 0 makes it velocity-dependent too."""

    def make(seed, m, speed=0.0, name="gds"):
        rng = np.random.default_rng(seed)
        root = rng.normal(size=(m, m))
        return GeometricDynamicalSystem.of(
            Partial(warped_metric, jnp.asarray(rng.normal(size=(m * m, m))), jnp.asarray(rng.normal(size=m)), speed),
            Partial(log_cosh_potential, jnp.asarray(rng.normal(size=m))),
            Partial(constant_damping, jnp.asarray(root @ root.T)),
            name,
        )

    return make
