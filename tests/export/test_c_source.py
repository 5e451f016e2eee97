"""What a policy gives in C is what JAX gives, state after state; and what has no form in C says so."""

import contextlib
import re
import subprocess
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrmp
from jaxrmp import acceleration, export
from jaxrmp.leaves import Damping, Posture
from jaxrmp.world import Spheres, World
from jaxrmp.xla import layout, machinery

from ..xla.examples import LEAVES, MAPS, RNG, of_leaf, of_map, tree_24_pairs
from .calling import STRICT, apart, compiled_c, needs_compiler, packed

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
    error, within = apart(given, expected), WITHIN[precision]
    if error > within:
        with in_precision(precision):
            nudged = by_jax(function, fixed, [a * a.dtype.type(1 + 2 * np.finfo(a.dtype).eps) for a in states])
        within = AS_ROUNDED * apart(nudged, expected)
    assert error <= within, found.operations


def by_jax(function, fixed, states):
    with machinery(False):
        many = jax.jit(jax.vmap(function, (None,) * len(fixed) + (0,) * len(states)))
        return [np.asarray(a) for a in jax.tree.leaves(many(*fixed, *states)) if a.size]


def states(count, shape):
    return 0.9 * RNG.uniform(-1, 1, (count, *shape)) + 0.1, RNG.normal(size=(count, *shape))


@needs_compiler
@PRECISIONS
@pytest.mark.parametrize("kind", LEAVES, ids=lambda kind: kind.__name__)
def test_every_leaf(kind, precision, tmp_path):
    leaf, shape = LEAVES[kind]
    assert_c_is_jax(partial(of_leaf, leaf), precision, tmp_path, (), *states(MANY, shape))


@needs_compiler
@PRECISIONS
@pytest.mark.parametrize("kind", MAPS, ids=lambda kind: kind.__name__)
def test_every_map(kind, precision, tmp_path):
    psi, shape = MAPS[kind]
    assert_c_is_jax(partial(of_map, psi), precision, tmp_path, (), *states(MANY, shape))


def policy_24_pairs(goal, q, qd):
    return acceleration(tree_24_pairs(goal), q, qd)


def arm_states(count):
    middle = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    return middle + 0.2 * RNG.normal(size=(count, 7)), 0.3 * RNG.normal(size=(count, 7))


@needs_compiler
@PRECISIONS
def test_whole_policy_of_24_pairs(precision, tmp_path):
    goal = np.array([0.45, 0.35, 0.45])
    assert_c_is_jax(policy_24_pairs, precision, tmp_path, (goal,), *arm_states(5 * MANY))
