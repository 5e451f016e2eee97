"""Functions written in C, several states at a time, give what JAX gives; and what cannot be written is mapped."""

import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp._linalg import cholesky
from jaxrmp.xla import _c_compiler, _lanes, in_lanes, report
from jaxrmp.xla._c_lanes import c_program

RNG = np.random.default_rng(0)
COMPILER = pytest.mark.skipif(not shutil.which("cc"), reason="needs a C compiler")
pytestmark = COMPILER


def assert_written(function, *examples, in_axes=0):
    (part,) = report(in_lanes(function), *examples, batch=8, in_axes=in_axes)
    assert part.taken_apart, part.reason


def both(function, *arguments, in_axes=0):
    found = jax.jit(jax.vmap(in_lanes(function), in_axes))(*arguments)
    return found, jax.jit(jax.vmap(function, in_axes))(*arguments)


def assert_same(found, expected, rtol):
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol * 10)


WEIGHTS = RNG.normal(size=(3, 40, 25)).astype(np.float32)
PICKED = np.array([[2, 0], [1, 1]])
ONE_HOT = np.eye(30, dtype=np.float32)[:, [3, 7, 7, 29]] - np.eye(30, dtype=np.float32)[:, [0, 1, 2, 3]]
MASK = np.kron(np.eye(3), np.ones((5, 5))).astype(np.float32)


def in_blocks(x):
    return MASK * jnp.outer(x[:15], x[30:45])


LARGE = {
    "layers": lambda x: jax.nn.relu(jnp.einsum("kij,kj->ki", WEIGHTS, x.reshape(3, 25))),
    "a network's slope": jax.grad(lambda x: jnp.sum(jnp.tanh(WEIGHTS[0] @ x[:25]) ** 2)),
    "products of lanes": lambda x: (x.reshape(3, 25) * jnp.sum(x)) @ x.reshape(25, 3),
    "symmetric": lambda x: jnp.outer(x[:7], x[:7]) @ jnp.outer(x[:7], x[:7]).T,
    "softmax": lambda x: jax.nn.softmax(-(x.reshape(3, 25) ** 2) * 40) @ x[:25],
    "reductions": lambda x: [f(x.reshape(3, 25), axis=k) for f in (jnp.sum, jnp.max, jnp.min) for k in (0, 1)],
    "truth": lambda x: (jnp.all(x < 3), jnp.any(x > 1), jnp.where(x > 0, x, -2 * x), (x > 0).astype(jnp.float32)),
    "whole numbers": lambda x: (jnp.sum((3 * x).astype(jnp.int32)), jnp.where(x[0] > 0, 3, -4), jnp.abs(x[:3]) > 0.5),
    "chosen entries": lambda x: (x.reshape(25, 3)[PICKED], x[np.arange(40) % 7] * x[:40], x[:30] @ ONE_HOT),
    "known entries": lambda x: jnp.concatenate([x[:20], jnp.zeros(20), jnp.arange(20.0)]) * 2 + jnp.ones(60),
    "mixed sources": lambda x: jnp.stack([x[:20] + 1, x[20:40] * 2, x[30:50]]) ** 2,
    "views of what is made": lambda x: (lambda y: y[::-1] * y + y.reshape(5, 15).T.reshape(-1))(jnp.sin(x)),
    "blocks of zeros": lambda x: in_blocks(x) @ in_blocks(x[::-1]).T + jnp.sum(in_blocks(x) / 3 - in_blocks(x[::-1])),
    "factors of blocks": lambda x: cholesky(in_blocks(x) @ in_blocks(x).T + 4 * jnp.eye(15)),
    "not used": lambda x: (x[:2], jnp.zeros(3)),
    "no numbers at all": lambda x: (jnp.sum(x[:0]), jnp.max(x.reshape(5, 15)[:, :0], axis=1, initial=-1.0), x**0),
    "beyond whole numbers": lambda x: (x * 3e9).astype(jnp.int32),
    "layers one after the other": lambda x: jax.lax.scan(lambda y, W: (jnp.tanh(W @ y[:25]), y[0]), x[:40], WEIGHTS),
    "the same backwards": lambda x: jax.lax.scan(
        lambda y, W: (jnp.tanh(W @ y[:25]), y[:3]), x[:40], WEIGHTS, reverse=True
    ),
    "clipped": lambda x: jnp.clip(x, -0.5, 0.5) + jnp.round(x) + jnp.sign(x),
}


@pytest.mark.parametrize("name", LARGE)
def test_large_arrays(name):
    x = RNG.normal(size=(21, 75)).astype(np.float32)
    assert_written(LARGE[name], x[0])
    assert_same(*both(LARGE[name], x), 2e-5)


def test_what_is_known_to_be_zero_costs_nothing():
    """Branches of a robot do not move each other: work grows with the branches, not with their cube."""

    def work(branches):
        mask = np.kron(np.eye(branches), np.ones((6, 6))).astype(np.float32)

        def function(x):
            A = mask * jnp.outer(x, x)
            return cholesky(A @ A.T + jnp.eye(len(x)))

        jaxpr = jax.make_jaxpr(function)(np.zeros(6 * branches, np.float32))
        return c_program(jaxpr, [True]).operations

    assert work(6) < 3 * work(3)


@pytest.mark.parametrize("states", [4, 7, 8, 1000])
def test_every_size_of_a_batch_and_what_its_states_share(states):
    def function(shared, x, scale):
        return jnp.tanh(shared @ x) * scale, jnp.sum(shared), x[0] > 0

    shared, x = RNG.normal(size=(30, 20)), RNG.normal(size=(20, states))
    arguments = [a.astype(np.float32) for a in (shared, x, RNG.normal(size=states))]
    found, expected = both(function, *arguments, in_axes=(None, 1, 0))
    assert_same(found, expected, 1e-5)
    twice = jax.vmap(jax.vmap(in_lanes(function), (None, 1, 0)), (0, None, None))
    for a, b in zip(twice(arguments[0][None], *arguments[1:]), expected, strict=True):
        np.testing.assert_allclose(a[0], b, rtol=1e-5, atol=1e-5)


def test_exponential_logarithm_and_hyperbolic_tangent_to_the_last_digits():
    """As precise as single precision has room for, also where it ends."""
    bits = np.arange(-(2**31), 2**31, 40_009).astype(np.int32)
    x = bits.view(np.float32)
    x = np.concatenate([x, np.float32([0, -0.0, np.inf, -np.inf, np.nan, 1, -1, 88.7, -87.3])])
    x = x[(np.abs(x) >= np.finfo(np.float32).tiny) | (x == 0) | np.isnan(x)]  # XLA takes what is smaller for zero
    found = jax.jit(jax.vmap(in_lanes(lambda x: (jnp.exp(x), jnp.log(x), jnp.tanh(x)))))(x)
    exact = x.astype(np.float64)
    with np.errstate(all="ignore"):
        for value, expected in zip(found, (np.exp(exact), np.log(exact), np.tanh(exact)), strict=True):
            expected = expected.astype(np.float32)
            expected[np.abs(expected) < np.finfo(np.float32).tiny] = 0  # numbers below the normal ones may be zero
            value = np.where(np.abs(value) < np.finfo(np.float32).tiny, 0, value)
            np.testing.assert_allclose(value, expected, rtol=2e-7, atol=0)


def test_what_is_not_finite_stays_in_its_state():
    x = np.ones((20, 40), np.float32)
    x[7, 1], x[9, 0], x[11, 2] = np.nan, np.inf, 3e9
    found, expected = both(lambda x: (x * 2, jnp.max(x), jnp.sum(x), jnp.isfinite(x), jnp.maximum(x, 0)), x)
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def test_slopes_are_those_of_jax():
    function = lambda x: jnp.sum(jnp.tanh(jnp.outer(x, x)))  # noqa: E731
    x = RNG.normal(size=(9, 20)).astype(np.float32)
    slopes = [jax.jit(jax.grad(lambda x, f=f: jnp.sum(jax.vmap(f)(x))))(x) for f in (in_lanes(function), function)]
    np.testing.assert_allclose(*slopes, rtol=1e-5)


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (jnp.sort, "holds `sort`"),
        (lambda x: x.astype(jnp.float16) * 2, "float16"),
        (lambda x: jnp.round(x).astype(jnp.int32) // 3, "whole numbers"),
        (lambda x: jax.lax.fori_loop(0, 300, lambda _, x: x * 0.9, x), "holds `scan` of 300 steps"),
        (lambda x: x[jnp.argmax(x)], "holds `argmax`"),
        (lambda x: ((x > 0) < (x > 1)) * x, "`lt` of bool"),
        (lambda x: (x * 100).astype(jnp.int8).astype(jnp.float32), "int8"),
        (lambda x: (x.astype(jnp.int32).astype(jnp.uint32) > 5) * x, "uint32"),
    ],
)
def test_what_cannot_be_written_is_mapped_and_says_why(function, reason, caplog):
    x = RNG.normal(size=(9, 5)).astype(np.float32)
    (part,) = report(in_lanes(function), x[0], batch=9)
    assert not part.taken_apart and reason in part.reason
    with caplog.at_level("INFO", "jaxrmp.xla"):
        found, expected = both(function, x)
    np.testing.assert_array_equal(found, expected)
    assert reason in caplog.text


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    """Nothing compiled yet, and programs kept in a folder of the test's own."""
    caches = (_lanes._native_of, _c_compiler.compiler_here)
    monkeypatch.setenv("JAXRMP_CACHE", str(tmp_path / "programs"))
    for cache in caches:
        cache.cache_clear()
    yield tmp_path / "programs"
    for cache in caches:
        cache.cache_clear()


def test_programs_are_kept(fresh):
    x = RNG.normal(size=(9, 5)).astype(np.float32)
    for _ in range(2):
        jax.jit(jax.vmap(in_lanes(lambda x: x * 3 + 1)))(x)
    (kept,) = fresh.iterdir()
    assert kept.suffix == ".so"


def test_a_program_that_was_written_by_half_is_compiled_again(fresh):
    fresh.mkdir()
    x = RNG.normal(size=(9, 5)).astype(np.float32)
    program = _lanes.c_program(jax.make_jaxpr(jax.jit(lambda x: [x * 7 + 1]))(x[0]), (True,))
    library = _lanes._compiled(program.text)
    library.write_bytes(b"")
    np.testing.assert_allclose(jax.jit(jax.vmap(in_lanes(lambda x: x * 7 + 1)))(x), x * 7 + 1, rtol=1e-6)
    assert library.stat().st_size


def test_named_axes_are_left_to_jax():
    x = RNG.normal(size=(9, 5)).astype(np.float32)
    found = jax.vmap(in_lanes(lambda x: x - jax.lax.pmean(x, "i")), axis_name="i")(x)
    np.testing.assert_allclose(found, x - x.mean(axis=0), atol=1e-6)


@pytest.mark.parametrize("compiler", ["", "false"])
def test_without_a_compiler_batches_are_mapped_and_a_warning_says_so(compiler, fresh, monkeypatch, caplog):
    monkeypatch.setenv("PATH", "") if not compiler else monkeypatch.setenv("CC", shutil.which(compiler))
    x = RNG.normal(size=(9, 5)).astype(np.float32)
    with caplog.at_level("WARNING", "jaxrmp.xla"):
        found, expected = both(lambda x: x * 5 + 1, x)
    np.testing.assert_array_equal(found, expected)
    assert "runs slower" in caplog.text
    assert not fresh.exists() or not list(fresh.iterdir())
