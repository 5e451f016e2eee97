"""Loops that end by a condition, in C: as JAX's up to the count that is stated, and never silently cut off."""

import subprocess
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, ExportError, compiled, export
from jaxrmp.xla import layout

from .calling import PRECISIONS, STRICT, apart, by_jax, compiled_c, in_precision, needs_compiler, of_type, packed

RNG = np.random.default_rng(0)


def doubled(x, y):
    """`x` doubled until it is large, by what number of steps, and whether there were any."""

    def step(state):
        n, x, _ = state
        return n + 1, 2 * x + y, jnp.bool_(True)

    return jax.lax.while_loop(lambda state: jnp.sum(state[1]) < 10, step, (0, x, jnp.bool_(False)))


def within(x, y):
    """A loop in a loop."""

    def step(state):
        return doubled(state[0] / 8, y)[1], state[1] + 1

    return jax.lax.while_loop(lambda state: state[1] < 3, step, (x, 0))


def states(precision):
    return of_type(precision, [np.abs(RNG.normal(size=(200, 3))) for _ in range(2)])


@needs_compiler
@PRECISIONS
def test_a_loop_is_jaxs_up_to_its_count_and_says_where_it_was_cut_off(precision, tmp_path):
    x, y = states(precision)
    with in_precision(precision):
        expected = by_jax(doubled, (), (x, y))
        enough, few = (export.c(doubled, x[0], y[0], max_iterations=most) for most in (20, 2))
    *found, hit = compiled_c(enough, tmp_path)(x, y)
    assert apart(found, expected) < 1e-6 and not hit.any()
    *found, hit = compiled_c(few, tmp_path / "few")(x, y)
    longer = expected[0] > 2
    assert 10 < longer.sum() < 190
    np.testing.assert_array_equal(hit, longer)
    np.testing.assert_array_equal(found[0], np.minimum(expected[0], 2))
    assert apart([f[~longer] for f in found], [e[~longer] for e in expected]) < 1e-6
    twice = 2 * (2 * x + y) + y
    assert apart([found[1][longer]], [twice[longer]]) < 1e-6


@needs_compiler
def test_a_loop_in_a_loop_that_is_cut_off_says_so(tmp_path):
    x, y = states("float")
    expected = by_jax(within, (), (x, y))
    *found, hit = compiled_c(export.c(within, x[0], y[0], max_iterations=20), tmp_path)(x, y)
    assert apart(found, expected) < 1e-5 and not hit.any()
    *_, hit = compiled_c(export.c(within, x[0], y[0], max_iterations=3), tmp_path / "few")(x, y)
    assert hit.any()


_MAIN = """
#include <stdio.h>
#include "policy.h"
int main(void) {
    static policy_in in; policy_out out;
    while (fread(&in, sizeof in, 1, stdin)) { policy(&in, &out); fwrite(&out, sizeof out, 1, stdout); }
    return 0;
}
"""


@needs_compiler
def test_sanitizers_find_nothing(tmp_path):
    x, y = states("float")
    x[7, 1] = np.nan
    found = export.c(within, x[0], y[0], max_iterations=20)
    source, _ = found.write(tmp_path)
    (tmp_path / "main.c").write_text(_MAIN)
    flags = f"{STRICT} -O1 -fsanitize=undefined,address -fno-sanitize-recover=all".split()
    subprocess.run(
        ["gcc", *flags, str(source), str(tmp_path / "main.c"), "-o", str(tmp_path / "run"), "-lm"], check=True
    )
    ran = subprocess.run([str(tmp_path / "run")], input=packed(found, x, y).tobytes(), capture_output=True, check=True)
    assert not ran.stderr
    results = np.frombuffer(ran.stdout, layout(found.outputs))
    assert len(results) == len(x) and not results["bound_hit"].any()


@needs_compiler
def test_from_python_a_loop_that_is_cut_off_is_an_error():
    x, y = (a[0] for a in states("float"))
    call = compiled(doubled, x, y, backend="c", max_iterations=20)
    assert apart([a[None] for a in call(x, y)], [np.asarray(a)[None] for a in doubled(x, y)]) < 1e-6
    with pytest.raises(ExportError, match="a `while` was cut off after 1 steps: give a larger max_iterations"):
        compiled(doubled, x, y, backend="c", max_iterations=1)(0 * x, y / 100)
    with pytest.raises(ConfigurationError, match='max_iterations is for backend="c"'):
        compiled(doubled, x, y, max_iterations=1)


def test_a_count_has_to_be_stated_and_make_sense():
    x, y = (a[0] for a in states("float"))
    with pytest.raises(
        ExportError, match="holds `while`, in .*state how many it may take at most, by max_iterations=N"
    ):
        export.c(doubled, x, y)
    with pytest.raises(ExportError, match="holds `while` without a stated count of steps, state max_iterations=N"):
        compiled(doubled, x, y, backend="c")
    for make in (export.c, partial(compiled, backend="c")):
        for odd in (0, -3, 2.0, True):
            with pytest.raises(ConfigurationError, match=f"max_iterations is {odd}, expected a whole number of steps"):
                make(doubled, x, y, max_iterations=odd)
    with pytest.raises(ConfigurationError, match="a result is called 'bound_hit'"):
        export.c(lambda x: {"bound_hit": x}, x, max_iterations=3)
