"""Exported C, compiled as a user would and called from Python."""

import contextlib
import ctypes
import shutil
import subprocess

import jax
import numpy as np
import pytest

from jaxrmp import export
from jaxrmp.xla import layout, machinery

needs_compiler = pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
STRICT = "-std=c99 -Wall -Wextra -Werror"


def compiled_c(found, folder, flags="-O2"):
    """A `CSource` as a function of many states: arrays [N, ...] for each of its fields, to a dict of the same."""
    source, _ = found.write(folder)
    library = source.with_suffix(".so")
    command = ["gcc", *STRICT.split(), *flags.split(), "-fPIC", "-shared", str(source), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    function = getattr(ctypes.CDLL(str(library)), found.name)
    function.restype = None
    size_in, size_out = layout(found.inputs).itemsize, layout(found.outputs).itemsize

    def call(*arguments):
        given = packed(found, *arguments)
        results = np.zeros(len(given), layout(found.outputs))
        begin, end = given.ctypes.data, results.ctypes.data
        for k in range(len(given)):
            function(ctypes.c_void_p(begin + k * size_in), ctypes.c_void_p(end + k * size_out))
        return [results[field.name] for field in found.outputs if field.size]

    return call


def packed(found, *arguments):
    """Arguments as structs, one a state; arrays without a leading axis of states are the same for all."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(arguments)]
    fields = zip(found.inputs, leaves, strict=True)
    count = max(len(a) for f, a in zip(found.inputs, leaves, strict=True) if a.ndim > len(f.shape))
    given = np.zeros(count, layout(found.inputs))
    for field, leaf in fields:
        if field.size:
            given[field.name] = leaf
    return given


def apart(found, expected):
    """The largest difference of results, each relative to the largest entry of it in the same state, and at least 1."""
    worst = 0.0
    for a, b in zip(found, [b for b in jax.tree.leaves(expected) if b.size], strict=True):
        b = np.asarray(b)
        assert a.dtype == b.dtype and a.shape == b.shape and np.isfinite(a).all() and np.isfinite(b).all()
        if b.dtype == bool:
            assert (a == b).all()
            continue
        scale = np.maximum(np.abs(b).reshape(len(b), -1).max(axis=1), 1)
        worst = max(worst, float((np.abs(a - b).reshape(len(b), -1).max(axis=1) / scale).max()))
    return worst


MANY = 2000
PRECISIONS = pytest.mark.parametrize("precision", ["float", "double"])
TYPES = {"float": np.float32, "double": np.float64}
WITHIN = {"float": 1e-5, "double": 1e-10}
AS_ROUNDED = 8  # times what rounding the state once changes, where that is more


def in_precision(precision):
    return jax.enable_x64(True) if precision == "double" else contextlib.nullcontext()


def of_type(precision, tree):
    return jax.tree.map(lambda a: np.asarray(a, TYPES[precision] if a.dtype != bool else bool), tree)


def assert_c_is_jax(function, precision, folder, fixed, *states):
    """What a function of `fixed` arguments and states [N, ...] gives in C is what it gives by JAX as written."""
    fixed, states = of_type(precision, fixed), of_type(precision, states)
    with in_precision(precision):
        found = export.c(function, *fixed, *jax.tree.map(lambda a: a[0], states))
        expected = by_jax(function, fixed, states)
    given = compiled_c(found, folder)(*fixed, *states)
    assert within_rounding(given, expected, function, precision, fixed, states)


def within_rounding(given, expected, function, precision, fixed, states):
    """Whether results in C are those `expected` of JAX to what a precision promises, or, where that is more, to what
    rounding the states changes."""
    if (error := apart(given, expected)) <= WITHIN[precision]:
        return True
    changed = 0.0
    with in_precision(precision):
        for by in (2, -2):  # one alone may by chance be rounded to what changes little
            nudged = by_jax(function, fixed, [a * a.dtype.type(1 + by * np.finfo(a.dtype).eps) for a in states])
            changed = max(changed, apart(nudged, expected))
    return error <= AS_ROUNDED * changed


def by_jax(function, fixed, states):
    with machinery(False):
        many = jax.jit(jax.vmap(function, (None,) * len(fixed) + (0,) * len(states)))
        return [np.asarray(a) for a in jax.tree.leaves(many(*fixed, *states)) if a.size]
