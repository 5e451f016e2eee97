"""`compiled(..., backend="c")` gives what JAX gives, refuses other arguments, and says what it cannot do."""

import shutil
import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrmp
from jaxrmp import compiled
from jaxrmp.leaves import Damping, Posture
from jaxrmp.xla import _c_compiler

COMPILER = pytest.mark.skipif(not shutil.which("cc"), reason="needs a C compiler")
Q = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)


def policy(given, q, qd):
    tree = Posture(given["rest"], stiffness=4.0) + Damping()
    return {"qdd": jaxrmp.acceleration(tree, q, qd), "moves": jnp.any(qd > 0) & given["on"]}


@COMPILER
def test_it_gives_what_jax_gives():
    given = {"rest": Q[0], "on": True}
    call, plain = compiled(policy, given, Q[0], Q[0], backend="c"), jax.jit(policy)
    for k, (q, qd) in enumerate(zip(Q, Q[::-1], strict=True)):
        given = {"rest": Q[k // 2].astype(float), "on": k % 3 == 0}  # in JAX's precision
        found, expected = call(given, q, qd), plain(given, q, qd)
        np.testing.assert_allclose(found["qdd"], expected["qdd"], rtol=1e-5, atol=1e-6)
        assert found["moves"].dtype == bool and found["moves"] == expected["moves"]
    with jax.enable_x64(True):
        double = compiled(lambda q: jnp.sin(q) / 3, Q[0].astype(float), backend="c")
    np.testing.assert_allclose(double(Q[1].astype(float)), np.sin(Q[1].astype(float)) / 3, rtol=1e-14)


@COMPILER
def test_results_stay_and_threads_take_turns():
    call = compiled(lambda q: q * 2, Q[0], backend="c")
    first = call(Q[0])
    call(Q[1])
    np.testing.assert_array_equal(first, 2 * Q[0])
    wrong = []

    def repeatedly(k):
        wrong.extend(n for n in range(2000) if not (call(Q[k]) == 2 * Q[k]).all())

    threads = [threading.Thread(target=repeatedly, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@COMPILER
def test_it_refuses_what_it_was_not_compiled_for():
    call = compiled(lambda q, k: q * k, Q[0], 2, backend="c")
    with pytest.raises(jaxrmp.ShapeError, match=r"shape \(2,\)"):
        call(Q[0, :2], 3)
    with pytest.raises(jaxrmp.ShapeError, match="float64; this was compiled for .* and int32"):
        call(Q[0], 2.5)
    with pytest.raises(jaxrmp.ShapeError, match="the arguments are"):
        call(Q[0])
    np.testing.assert_array_equal(call(Q[0], 3), 3 * Q[0])


def test_it_says_what_it_cannot_do(monkeypatch):
    with pytest.raises(jaxrmp.ExportError, match="holds `sort`"):
        compiled(jnp.sort, Q[0], backend="c")
    with pytest.raises(jaxrmp.UnknownNameError, match="backend 'C'"):
        compiled(jnp.sin, Q[0], backend="C")
    _c_compiler.compiler_here.cache_clear()
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(jaxrmp.ExportError, match="there is no C compiler"):
        compiled(lambda q: q * 2.5, Q[0], backend="c")
    _c_compiler.compiler_here.cache_clear()


def test_what_a_stack_does_not_hold_is_refused():
    with pytest.raises(jaxrmp.ExportError, match="bytes of working memory"):
        compiled(lambda x: jnp.max(jnp.sin(x)) * jnp.sin(x[::-1]), np.zeros(1_000_000, np.float32), backend="c")
