"""Elementwise operations that no table here names: taken by their own rules, or said."""

import logging
import re
import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import batching, mlir

import jaxrmp
from jaxrmp._errors import ExportError
from jaxrmp.xla import in_lanes, one_loop, report
from jaxrmp.xla._elementwise import in_known_operations, is_elementwise

NEEDS_C = pytest.mark.skipif(not shutil.which("cc"), reason="needs a C compiler")
STATES = 100
X = np.random.default_rng(0).uniform(-0.9, 0.9, (STATES, 4))


def primitive(name, function, batcher=None):
    """An operation of one array that JAX knows and this machinery does not."""
    made = Primitive(name)
    made.def_impl(jax.jit(function))
    made.def_abstract_eval(lambda x, **_: x)
    mlir.register_lowering(made, mlir.lower_fun(function, multiple_results=False))
    if batcher is None:
        batching.defvectorized(made)
    else:
        batching.primitive_batchers[made] = batcher
    return made


def one_minus_cube(x, *, factor):
    return jnp.where(jnp.isfinite(x), 1 - factor * x * lax.square(x), x.astype(f"i{x.dtype.itemsize}").astype(x.dtype))


CUBE = primitive("one_minus_cube", one_minus_cube)
RARE = primitive("rare", lax.lgamma)


def running(x):
    return lax.cumsum(x, axis=x.ndim - 1) if x.ndim else x


def over_the_first(given, dimensions):
    moved = jnp.moveaxis(given[0], dimensions[0], 0)
    return (RUNNING.bind(moved) if moved.ndim > 1 else moved), 0


# Of its argument's shape, without a setting, and of scalars the same: but not of each entry on its own.
RUNNING = primitive("running", running, over_the_first)


def cube(x):
    return CUBE.bind(x, factor=2.0)


def equation_of(function, *arguments):
    return jax.make_jaxpr(function)(*arguments).jaxpr.eqns[-1]


@pytest.mark.parametrize(
    "function",
    [cube, RARE.bind, jnp.sin, lambda x: jnp.arctan2(x, x), lambda x: x < 0.5, lax.erf_inv, lambda x: lax.pow(x, 2)],
    ids=["made", "rare", "sin", "of two", "with a scalar", "erf_inv", "of two types"],
)
@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_elementwise_is_what_is_the_same_however_it_is_mapped(function, shape):
    assert is_elementwise(equation_of(function, jnp.ones(shape)))


@pytest.mark.parametrize(
    "function",
    [
        RUNNING.bind,
        lambda x: lax.cumsum(x, axis=0),
        lambda x: lax.rev(x, (0,)),
        lax.sort,
        lax.linalg.cholesky,
    ],
    ids=["running", "cumsum", "rev", "sort", "cholesky"],
)
def test_what_keeps_a_shape_is_not_for_that_elementwise(function, request):
    name = request.node.callspec.id
    (equation,) = [e for e in jax.make_jaxpr(function)(jnp.eye(3)).jaxpr.eqns if e.primitive.name == name]
    assert equation.outvars[0].aval.shape == (3, 3) and not is_elementwise(equation)


@pytest.mark.parametrize("function", [lambda x: cube(x) @ x, lambda x: cube(x[0]) * RARE.bind(x)], ids=["", "rare"])
def test_in_one_loop(function, x64):
    (part,) = report(one_loop(function), X[0], batch=STATES)
    assert part.taken_apart, part.reason
    found = jax.jit(jax.vmap(one_loop(function)))(X)
    np.testing.assert_allclose(found, jax.vmap(jax.jit(function))(X), rtol=1e-12, atol=1e-12)


def test_what_only_looks_elementwise_is_mapped_as_it_stands(x64):
    (part,) = report(one_loop(RUNNING.bind), X[0], batch=STATES)
    assert not part.taken_apart and part.reason == "holds `running`"
    np.testing.assert_allclose(jax.jit(jax.vmap(one_loop(RUNNING.bind)))(X), np.cumsum(X, axis=1), rtol=1e-12)


@NEEDS_C
@pytest.mark.parametrize("size", [1, 4, 40])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_in_c_by_what_jax_lowers_it_to(size, dtype):
    with jax.enable_x64(dtype == np.float64):
        rtol = 3e-6 if dtype == np.float32 else 1e-12
        x = np.random.default_rng(0).uniform(-0.9, 0.9, (STATES, size)).astype(dtype)
        x[3, 0] = np.inf
        (part,) = report(in_lanes(cube), x[0], batch=STATES)
        assert part.taken_apart, part.reason
        expected = jax.jit(jax.vmap(cube))(x)
        np.testing.assert_allclose(jax.jit(jax.vmap(in_lanes(cube)))(x), expected, rtol=rtol, atol=10 * rtol)
        alone = jaxrmp.compiled(cube, x[0], backend="c")
        np.testing.assert_allclose(alone(x[1]), expected[1], rtol=rtol, atol=10 * rtol)


def test_numbers_keep_their_types_in_what_it_is_made_of():
    closed = in_known_operations(equation_of(cube, jnp.ones(3, np.float32)))
    assert closed is not None and [a.dtype for a in closed.out_avals] == [np.float32]
    assert in_known_operations(equation_of(RARE.bind, jnp.ones(3))) is None


@NEEDS_C
def test_what_has_no_form_in_c_is_said_once_and_is_mapped(caplog):
    for factor in (1.0, 2.0):
        function = in_lanes(lambda x, factor=factor: factor * RARE.bind(x + 2))
        with caplog.at_level(logging.WARNING, "jaxrmp.xla"):
            found = jax.jit(jax.vmap(function))(X.astype(np.float32))
        np.testing.assert_allclose(found, factor * lax.lgamma(X.astype(np.float32) + 2), rtol=1e-4, atol=1e-5)
    (said,) = [r.getMessage() for r in caplog.records if r.name == "jaxrmp.xla"]
    assert "`rare`" in said and "slower" in said and jax.__version__ in said


def test_an_export_without_a_form_in_c_names_the_operation():
    x = np.ones(3, np.float32)
    with pytest.raises(ExportError, match=re.escape("`rare`")):
        jaxrmp.export.c(RARE.bind, x)
    assert "bound_hit" not in jaxrmp.export.c(cube, x).source


def test_the_slope_of_tanh_is_taken_apart():
    """`one_minus_square` from jax 0.12 on."""
    slope = jax.grad(lambda x: jnp.sum(jnp.tanh(x)))
    for written in (one_loop(slope), in_lanes(slope)):
        (part,) = report(written, X[0].astype(np.float32), batch=STATES)
        assert part.taken_apart, part.reason
