"""Functions taken apart into scalars give what they give state by state, and what cannot be taken apart is mapped."""

import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxrmp.xla import in_lanes, one_loop, report
from jaxrmp.xla._not_scalar import NotScalar
from jaxrmp.xla._scalar_program import scalar_program

STATES = 100
RNG = np.random.default_rng(0)


def by_states(function, *arguments):
    function = jax.jit(function)
    return jax.tree.map(lambda *parts: np.stack(parts), *(function(*state) for state in zip(*arguments, strict=True)))


def assert_same(found, expected):
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12), found, expected)


def taken_apart(function, *arguments):
    return scalar_program(jax.make_jaxpr(function)(*arguments))


ELEMENTWISE = {
    "inverse trigonometric": lambda x: (jnp.arctan2(x, 2 - x), jnp.arcsin(x / 4), jnp.arccos(x / 4), jnp.arctan(x)),
    "trigonometric": lambda x: (jnp.sin(x), jnp.cos(x), jnp.tan(x)),
    "hyperbolic": lambda x: (jnp.sinh(x), jnp.cosh(x), jnp.tanh(x), jnp.arcsinh(x), jnp.arctanh(x / 4)),
    "exponential": lambda x: (jnp.exp(x), jnp.exp2(x), jnp.expm1(x), jax.nn.sigmoid(x), jax.scipy.special.erf(x)),
    "logarithm": lambda x: (jnp.log(1 + x * x), jnp.log1p(x * x), jnp.abs(x) ** 1.5, x**3, x**-2, x**2),
    "root": lambda x: (jnp.sqrt(x * x), lax.rsqrt(1 + x * x), jnp.cbrt(x)),
    "rounding": lambda x: (jnp.floor(x), jnp.ceil(x), jnp.round(x), jnp.sign(x), x % 0.7, jnp.clip(x, -1, 1)),
    "comparison": lambda x: (x > 0, x <= 0.5, (x > 0) & ~(x > 1), jnp.isfinite(x), jnp.where(x > 0, x, 2.0), x != x),
    "whole numbers": lambda x: ((10 * x).astype(int) + 3, (10 * x).astype(int) * 2 > 1, jnp.maximum(x, -x)),
}
ARRAYS = {
    "products": lambda x: (x @ x, jnp.outer(x, x) @ x, jnp.einsum("i,jk,k->ji", x, jnp.outer(x, x), x)),
    "moves": lambda x: (x[::-1], jnp.stack([x, 2 * x], axis=1).T, jnp.concatenate([x[1:], x[:1]]), jnp.pad(x, (1, 2))),
    "sums": lambda x: (jnp.sum(jnp.outer(x, x), axis=1), jnp.max(x), jnp.min(jnp.outer(x, x), axis=0)),
    "known numbers": lambda x: (jnp.eye(4) @ x, jnp.diag(x) + jnp.zeros((4, 4)), jnp.ones(2), x * -0.0),
    "unstacked": lambda x: (*jnp.unstack(x), *jnp.unstack(jnp.outer(x, x), axis=1)),
    "splits": lambda x: jnp.split(x, [1, 3]),
    "slopes": lambda x: (jax.jacfwd(lambda x: x * jnp.sum(x**2))(x), jax.grad(lambda x: jnp.tanh(x @ x))(x)),
    "sums of nothing": lambda x: (x[:0] @ x[:0], x[:0].reshape(2, 0) @ x[:0].reshape(0, 3)),
    "as it came": lambda x: (x, {"again": x[1]}),
}


@pytest.mark.parametrize("name", [*ELEMENTWISE, *ARRAYS])
def test_same_as_state_by_state(name, x64):
    function = {**ELEMENTWISE, **ARRAYS}[name]
    x = RNG.uniform(-2, 2, (STATES, 4))
    taken_apart(function, x[0])
    assert_same(jax.jit(jax.vmap(one_loop(function)))(x), by_states(function, x))


@pytest.mark.skipif(not shutil.which("cc"), reason="needs a C compiler")
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", [*ELEMENTWISE, *ARRAYS])
def test_the_same_written_in_c(name, dtype):
    with jax.enable_x64(dtype == np.float64):
        rtol = 3e-6 if dtype == np.float32 else 1e-12
        function = {**ELEMENTWISE, **ARRAYS}[name]
        for size in (4, 30) if name in ELEMENTWISE else (4,):  # entry by entry, and as loops
            x = RNG.uniform(-2, 2, (37, size)).astype(dtype)
            (part,) = report(in_lanes(function), x[0], batch=37)
            assert part.taken_apart, part.reason
            found, expected = (jax.jit(jax.vmap(f))(x) for f in (in_lanes(function), function))
            for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
                assert a.dtype == b.dtype
                np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol * 10)


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
def test_single_and_half_precision_stay(dtype):
    x = RNG.uniform(-2, 2, (STATES, 4)).astype(dtype)
    found = jax.jit(jax.vmap(one_loop(lambda x: (x * x, x + 1))))(x)
    assert [a.dtype for a in found] == [dtype, dtype]
    np.testing.assert_array_equal(found[1], x + dtype(1))


def test_axes_within_a_state_come_last_in_order(x64):
    def pair(a, b, scale):
        return a @ b * scale, a - b

    mapped = one_loop(pair, (0, None, None), (None, 1, None))
    a, b, scale = RNG.normal(size=(STATES, 3, 2)), RNG.normal(size=(STATES, 2, 5)), RNG.normal(size=STATES)
    product, difference = jax.jit(jax.vmap(mapped))(a, b, scale)
    assert product.shape == (STATES, 3, 5) and difference.shape == (STATES, 2, 3, 5)
    assert_same(product, a @ b * scale[:, None, None])
    assert_same(difference, a.swapaxes(1, 2)[..., None] - b[:, :, None])
    assert_same(mapped(a[0], b[0], scale[0]), (product[0], difference[0]))


def test_what_is_shared_by_the_batch_and_what_is_closed_over(x64):
    x, shared, outer = RNG.normal(size=(STATES, 3)), RNG.normal(size=3), RNG.normal(size=(7, 3))

    def of_outer(outer):
        def function(x, shared, known):
            return x @ shared + jnp.sum(outer * x) * known

        return jax.vmap(one_loop(function), in_axes=(0, None, None))(x, shared, 2.0)

    assert_same(jax.jit(jax.vmap(of_outer))(outer), (x @ shared)[None] + 2 * outer @ x.T)


def test_an_array_of_double_precision_serves_in_single_precision_later():
    limit = np.linspace(0.1, 0.7, 7)  # NumPy's, as a robot's limits are
    below = one_loop(lambda limit, x: limit - x)
    with jax.enable_x64(True):
        double = jax.jit(jax.vmap(lambda x: below(limit, x)))(np.zeros((STATES, 7)))
    assert double.dtype == np.float64
    single = jax.jit(lambda limit, x: limit - x)(limit, np.zeros(7, np.float32))
    np.testing.assert_array_equal(single, limit.astype(np.float32))


def test_slopes_in_both_modes(x64):
    def function(x):
        return jnp.tanh(jnp.outer(x, x) @ x), jnp.sum(jnp.cos(x))

    x, xd = RNG.normal(size=(2, STATES, 3))
    loop, plain = jax.vmap(one_loop(function)), jax.vmap(function)
    assert_same(
        jax.jit(lambda x, xd: jax.jvp(loop, (x,), (xd,)))(x, xd),
        jax.jit(lambda x, xd: jax.jvp(plain, (x,), (xd,)))(x, xd),
    )

    def total(mapped):
        return lambda x: sum(jnp.sum(part**2) for part in mapped(x))

    assert_same(jax.jit(jax.grad(total(loop)))(x), jax.jit(jax.grad(total(plain)))(x))
    assert_same(jax.jit(jax.hessian(total(loop)))(x[:2]), jax.jit(jax.hessian(total(plain)))(x[:2]))


def test_what_is_not_finite_stays_in_its_state():
    x = np.ones((STATES, 3), np.float32)
    x[7, 1], x[9, 0] = np.nan, np.inf
    found = np.asarray(jax.jit(jax.vmap(one_loop(lambda x: jnp.stack([x * 2, x @ x * x]))))(x))
    assert np.isnan(found[7, :, 1]).all() and np.isinf(found[9, 0, 0])
    assert np.isfinite(np.delete(found, [7, 9], axis=0)).all()


def long(x, depth):
    for _ in range(depth):
        x = jnp.tanh(x) - 0.5
    return x


NOT_SCALAR = {
    "no arithmetic": lambda x: jnp.sort(x) + jnp.cumsum(x),
    "a loop": lambda x: lax.fori_loop(0, 3, lambda _, x: x * 0.9, x),
    "too many operations": lambda x: jnp.tanh(jnp.outer(jnp.arange(1000.0), x)).sum(axis=0),
    "too many results": lambda x: jnp.outer(jnp.arange(1.0, 101.0), x),
    "too deep": lambda x: long(x, 600),
    "a large product": lambda x: jnp.ones((100, 100)) @ (jnp.ones((100, 4)) @ x),
    "complex numbers": lambda x: x * 1j,
    "an index that moves": lambda x: x[jnp.argmax(x)],
}


@pytest.mark.parametrize("name", NOT_SCALAR)
def test_what_cannot_be_taken_apart_is_mapped(name, x64):
    function = NOT_SCALAR[name]
    x = RNG.uniform(-0.5, 0.5, (STATES, 4))
    with pytest.raises(NotScalar):
        taken_apart(function, x[0])
    assert_same(jax.jit(jax.vmap(one_loop(function)))(x), by_states(function, x))


def test_programs_of_the_largest_size_compile(x64):
    def deep(x):
        return long(x, 249), x

    def wide(x):
        return jnp.stack([jnp.sum(jnp.outer(x, x + i) ** 2) for i in range(50)]), x

    x = RNG.uniform(-0.5, 0.5, (STATES, 4))
    for function in (deep, wide):
        assert len(taken_apart(function, x[0]).steps) > 1900
        assert_same(jax.jit(jax.vmap(one_loop(function)))(x), by_states(function, x))


def test_nothing_that_is_known_to_be_zero_is_computed():
    program = taken_apart(lambda x: jnp.diag(jnp.array([0.0, 1.0, 2.0])) @ (x * 3) + jnp.zeros(3), np.ones(3))
    assert len(program.steps) == 2 + 3  # two entries, times three, and one of them times two


def test_one_operation_after_the_other_where_jit_is_disabled(x64):
    function = one_loop(lambda x, y: (x * y, jnp.sin(x)), (0, None))
    x, y = RNG.normal(size=5), RNG.normal()
    with jax.disable_jit():
        found = function(jnp.asarray(x), jnp.asarray(y))
    assert_same(found, (x * y, np.sin(x)))
    assert_same(function(jnp.asarray(x), jnp.asarray(y)), found)


def test_loops_within_loops(x64):
    inner = one_loop(lambda a, x: (a * x, a + x), (0, None))
    x = RNG.normal(size=(STATES, 3))
    found = jax.jit(jax.vmap(one_loop(lambda x: inner(x, x[0]))))(x)
    assert_same(found, (x * x[:, :1], x + x[:, :1]))


def test_without_states_and_without_entries():
    function = one_loop(lambda x, y: (x + 1, jnp.sum(y)), (0, None))
    found = jax.jit(jax.vmap(function))(np.zeros((STATES, 0)), np.zeros((STATES, 2)))
    assert [a.shape for a in found] == [(STATES, 0), (STATES, 0)]
    assert jax.vmap(one_loop(jnp.sin))(np.zeros((0, 3))).shape == (0, 3)
