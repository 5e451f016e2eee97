"""Loops in exported C that compilers make vectors of: products along each axis, and functions without branches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import export
from jaxrmp.xla import in_lanes

from .calling import apart, by_jax, compiled_c, needs_compiler

RNG = np.random.default_rng(0)
ODD = np.array([0.0, -0.0, 1e-30, -1e-30, 1e30, -1e30, 88.0, -88.0, -110.0, 0.34, 0.35, 9.0, np.inf, -np.inf, np.nan])
FLAGS = pytest.mark.parametrize("flags", ["-O2", "-O3 -march=native"])

weights = RNG.normal(size=(150, 7, 9)).astype(np.float32)
narrow = RNG.normal(size=(6, 32)).astype(np.float32)


def products(x):
    """Many small ones; few long sums, beside each other and of entries taken from here and there; a few rows."""
    A, B, P = x[:450].reshape(150, 3), x[450:1080].reshape(3, 210), x[:150] * x[150:300]
    many = jnp.einsum("nij,nj->ni", weights, jnp.concatenate([A, A * A, A + 1], axis=1))
    long = B @ B.T, B[0] @ B[1], jnp.concatenate([B[0, 5:105], P[::3]]) @ jnp.concatenate([x[7:57], B[1, ::-1][:100]])
    few = narrow @ x[:32], narrow @ x[:96].reshape(32, 3), (narrow * 2) @ jnp.tanh(x[:96]).reshape(32, 3)
    repeated = jnp.sin(jnp.broadcast_to(x[:20], (30, 20))).sum(axis=0), jnp.exp(jnp.outer(x[:5], x[5:15])).sum(axis=1)
    return many, jnp.max(many, axis=1), jnp.min(many, axis=0), long, few, repeated


@needs_compiler
@FLAGS
def test_products_along_each_axis(flags, tmp_path):
    x = RNG.normal(size=(20, 1080)).astype(np.float32)
    found = export.c(products, x[0])
    assert apart(compiled_c(found, tmp_path, flags)(x), by_jax(products, (), (x,))) < 1e-5


def test_the_same_in_lanes():
    x = RNG.normal(size=(20, 1080)).astype(np.float32)
    found = jax.jit(jax.vmap(in_lanes(products)))(x)
    assert apart([np.asarray(a) for a in jax.tree.leaves(found)], by_jax(products, (), (x,))) < 1e-5


def choices(x, y):
    return jnp.where(x > y, x, y), jnp.maximum(x, y), jnp.minimum(x, y), jnp.clip(x, -1, 1)


@needs_compiler
@FLAGS
def test_choices_keep_what_is_no_number(flags, tmp_path):
    x, y = (a.reshape(-1).astype(np.float32) for a in np.meshgrid(ODD, ODD))
    found = compiled_c(export.c(choices, x, y), tmp_path, flags)(x[None], y[None])
    for a, b in zip(found, choices(x, y), strict=True):
        np.testing.assert_array_equal(a[0], b)


@needs_compiler
@FLAGS
@pytest.mark.parametrize(
    ("function", "exact", "ulp"),
    [
        (jnp.exp, np.exp, 2),
        (jnp.expm1, np.expm1, 4),
        (jnp.sqrt, np.sqrt, 2),
        (jax.lax.rsqrt, lambda x: 1 / np.sqrt(x), 4),
        (jnp.tanh, np.tanh, 2),
    ],
    ids=["exp", "expm1", "sqrt", "rsqrt", "tanh"],
)
def test_functions_to_the_last_digits(function, exact, ulp, flags, tmp_path):
    x = np.concatenate([ODD, RNG.normal(size=3000), 10.0 ** RNG.uniform(-30, 30, 3000), RNG.uniform(-88, 88, 3000)])
    x = x.astype(np.float32)
    (found,) = compiled_c(export.c(function, x), tmp_path, flags)(x[None])
    with np.errstate(all="ignore"):
        expected = exact(x.astype(np.float64))
        single = expected.astype(np.float32)
    np.testing.assert_array_equal(np.isnan(found[0]), np.isnan(single))
    np.testing.assert_array_equal(np.isinf(found[0]), np.isinf(single))
    normal = np.isfinite(single) & (np.abs(single) > 1.2e-38)
    assert normal.sum() > 3000
    error = np.abs(found[0][normal] - expected[normal]) / np.spacing(np.abs(single[normal]))
    assert error.max() <= ulp
