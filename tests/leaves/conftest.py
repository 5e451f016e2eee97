"""The laws that every certified leaf obeys, for the tests of each."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import certificate


@pytest.fixture
def x64():
    with jax.enable_x64(True):
        yield


@jax.jit
def _laws(tree, x, xd):
    return jax.vmap(lambda x, xd: (certificate(tree, x, xd), tree(x, xd).M))(x, xd)


@pytest.fixture
def assert_certified():
    """Energy falls at the rate of dissipation, and the metric is symmetric and positive semi-definite."""

    def check(tree, x, xd):
        assert all(leaf.certified for leaf in tree.leaves())
        law, M = _laws(tree, x, xd)
        M = np.asarray(M)
        assert M.dtype == np.float64 and np.isfinite(M).all()
        assert np.max(law.residual) <= 1e-8
        assert (np.asarray(law.dissipation) >= 0).all()
        assert np.abs(law.dV_dt).max() > 1e-6  # the law is not 0 = 0
        size = np.abs(M).max(axis=(1, 2), keepdims=True)
        np.testing.assert_allclose(M / size, np.swapaxes(M, 1, 2) / size, atol=1e-13)
        assert (np.linalg.eigvalsh(M / size) >= -1e-12).all()

    return check


def _numbers(tree):
    return jax.tree.map(lambda p: jnp.asarray(p, float), tree)


def _total(leaf, x, xd):
    form = leaf(x, xd)
    return jnp.sum(form.f) + jnp.sum(form.M) + leaf.energy(x, xd) + leaf.dissipation(x, xd)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0, 0))
def _everything(leaf, x, xd):
    """Value, slopes in leaf and state, and a jvp of a jvp."""
    at = leaf, x, xd
    step = jax.tree.map(jnp.ones_like, at)
    twice = jax.jvp(lambda *at: jax.jvp(_total, at, step)[1], at, step)[1]
    return _total(*at), jax.grad(_total, argnums=(0, 1, 2))(*at), twice


@pytest.fixture
def assert_smooth():
    """jit and vmap agree with the plain call; slopes in state and parameters, and a jvp of a jvp, are finite."""

    def check(leaf, x, xd):
        leaf = _numbers(leaf)
        values, slopes, second = _everything(leaf, x, xd)
        np.testing.assert_allclose(values[0], _total(leaf, x[0], xd[0]), rtol=1e-12)
        for part in jax.tree.leaves((values, slopes, second)):
            assert np.isfinite(part).all()

    return check


@pytest.fixture
def assert_single():
    """Single precision states give single precision results, whatever the parameters are."""

    def check(leaf, x, xd):
        leaf, x, xd = _numbers(leaf), jnp.asarray(x, jnp.float32), jnp.asarray(xd, jnp.float32)
        values = jax.eval_shape(lambda: (leaf(x, xd), leaf.energy(x, xd), leaf.dissipation(x, xd)))
        assert {value.dtype.name for value in jax.tree.leaves(values)} == {"float32"}

    return check


@pytest.fixture
def traces_of():
    """How often one compiled program is traced for leaves whose numbers differ: each number doubled in turn."""

    def count(leaf, x, fixed=()):
        traces = []

        @jax.jit
        def run(leaf):
            traces.append(None)
            return leaf(x, x).f

        leaf = _numbers(leaf)
        run(leaf)
        for field in dataclasses.fields(leaf):
            value = getattr(leaf, field.name)
            if not field.metadata.get("static") and value is not None and field.name not in fixed:
                run(dataclasses.replace(leaf, **{field.name: 2 * value}))
        return len(traces)

    return count
