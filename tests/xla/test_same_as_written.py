"""In batches, the machinery gives what the mathematics as written gives, values and gradients: every leaf and map."""

import json
import os
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrmp
from jaxrmp import Batched, Leaf, TaskMap, acceleration, compose, pullback, resolve
from jaxrmp.io import load_lula
from jaxrmp.leaves import Damping, JointLimit, Learned, Posture
from jaxrmp.xla import in_lanes, machinery, report
from jaxrmp.xla._plan import FEWEST

from .examples import HAND, LEAVES, MAPS, POTENTIAL, RNG, ROBOT, SCENE, kinds, of_leaf, of_map, tree_24_pairs

MANY = FEWEST + 2  # states, a number that is no power of two


@pytest.mark.parametrize(("base", "examples"), [(Leaf, LEAVES), (TaskMap, MAPS)])
def test_every_leaf_and_map_has_an_example_here(base, examples):
    missing = {kind.__name__ for kind in kinds(base)} - {kind.__name__ for kind in examples}
    assert not missing, f"give an example of {sorted(missing)}, so that it is compared with what is written"


def sloping(function, *states):
    """What it gives, and that along a direction of the positions."""
    *others, x, xd = states
    return jax.jvp(lambda x: function(*others, x, xd), (x,), (jax.tree.map(lambda x: jnp.cos(3 * x), x),))


def slopes(function, *states):
    """What is differentiated is not taken apart."""
    return sloping(function, *states)[1]


def in_c(function, *states):
    """By C, where there is a compiler."""
    return in_lanes(function)(*states)


def assert_as_written(all_of_them, *states, rtol, in_axes=0, by_c=True, names=None):
    """What a batch gives by the machinery is what it gives as written: values, slopes and, if asked, values by C.

    `all_of_them(of, *state)` is a list of what `of(function, *state)` gives of each function, by name if there are
    names.
    """

    def many(of):
        return jax.jit(jax.vmap(partial(all_of_them, of), in_axes))(*states)

    with machinery(False):
        expected, expected_slopes = zip(*many(sloping), strict=True)
    ways = [(values, expected), (slopes, expected_slopes)] + [(in_c, expected)] * by_c
    for of, right in ways:
        for name, a, b in zip(names or [""], many(of), right, strict=True):
            assert_same(a, b, rtol, f"{of.__name__} {name}")


def values(function, *states):
    return function(*states)


def assert_same(found, expected, rtol, name=""):
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert np.isfinite(b).all()
        np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol * np.abs(b).max(initial=1), err_msg=name)


def states(batch, shape):
    return 0.9 * RNG.uniform(-1, 1, (batch, *shape)) + 0.1, RNG.normal(size=(batch, *shape))


def test_every_leaf(x64):
    def all_of_them(of, x, xd):
        return [of(partial(of_leaf, leaf), x[n], xd[n]) for n, (leaf, _) in enumerate(LEAVES.values())]

    x, xd = zip(*(states(MANY, shape) for _, shape in LEAVES.values()), strict=True)
    assert_as_written(all_of_them, x, xd, rtol=1e-9, names=[kind.__name__ for kind in LEAVES])


def alone(function):
    """`function` as the only one of a list."""
    return lambda of, *state: [of(function, *state)]


@pytest.mark.parametrize("kind", MAPS, ids=lambda kind: kind.__name__)
def test_every_map(kind, x64):
    psi, shape = MAPS[kind]
    assert_as_written(alone(partial(of_map, psi)), *states(MANY, shape), rtol=1e-9)


def policy_24_pairs(goal, q, qd):
    return acceleration(tree_24_pairs(goal), q, qd)


def arm_states(batch):
    middle = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    return middle + 0.2 * RNG.normal(size=(batch, 7)), 0.3 * RNG.normal(size=(batch, 7))


PARTS = {
    "ControlPoints._motions",
    "ControlPoints.transport.pull",
    "JointLimit.evaluate",
    "CollisionAvoidance.evaluate",
    "Damping.evaluate",
    "_solve_by_cholesky",
}


def test_whole_policy_of_24_pairs(x64):
    arguments = np.array([0.45, 0.35, 0.45]), *arm_states(MANY)
    assert_as_written(alone(policy_24_pairs), *arguments, rtol=1e-7, in_axes=(None, 0, 0))


def test_what_should_be_taken_apart_is():
    example = np.zeros(3, np.float32), np.zeros(7, np.float32), np.zeros(7, np.float32)
    (whole,) = report(policy_24_pairs, *example, batch=FEWEST, in_axes=(None, 0, 0))
    assert whole.name == "acceleration" and whole.taken_apart

    def in_loops(goal, q, qd):  # as where there is no C compiler
        return resolve(tree_24_pairs(goal)(q, qd))

    parts = report(in_loops, *example, batch=FEWEST, in_axes=(None, 0, 0))
    assert {part.name for part in parts} >= PARTS
    assert [part for part in parts if not part.taken_apart] == []
    assert max(part.operations for part in parts) <= 3000 < sum(part.operations for part in parts)
    few = report(in_loops, *example, batch=FEWEST - 1, in_axes=(None, 0, 0))
    assert {part.reason for part in few} == {f"a batch of {FEWEST - 1} < {FEWEST} states"}


def test_many_coordinates_are_taken_apart_one_by_one_where_they_are_alike():
    n = 500
    leaf = JointLimit(-np.ones(n) - np.arange(n) / n, np.ones(n), weight=jnp.arange(1.0, n + 1))
    (part,) = report(leaf.evaluate, np.zeros(n), np.zeros(n), batch=FEWEST)
    assert part.taken_apart and part.operations % n == 0
    x, xd = (a.astype(np.float32) for a in states(FEWEST, (n,)))
    found = jax.jit(jax.vmap(leaf.evaluate))(x, xd)
    with machinery(False):
        expected = jax.jit(jax.vmap(leaf.evaluate))(x, xd)
    assert_same(found, expected, 1e-4)


def test_a_skill(x64):
    keys = jax.random.split(jax.random.key(0), 2)
    learned = pytest.importorskip("jaxrmp.learning._metric_network")
    factors = jax.vmap(lambda key: learned.initial_cholesky_factor(key, hidden=(16, 8), length_scale=0.1))(keys)
    stacked = jax.tree.map(lambda a: jnp.stack([jnp.asarray(a)] * 2), POTENTIAL)
    leaves = Batched(Learned(stacked, factors, jnp.full(2, 0.2), jnp.full(2, 40.0)))

    def policy(T, q, qd):
        tree = pullback(compose(HAND, jaxrmp.RigidTransform(T)), leaves)
        return acceleration(tree + JointLimit(ROBOT.lower, ROBOT.upper) + Damping(), q, qd)

    assert_as_written(alone(policy), np.eye(4), *arm_states(MANY), rtol=1e-5, in_axes=(None, 0, 0))


def test_lula(x64):
    folder = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "lula"
    if not folder.is_dir():
        pytest.skip("needs NVIDIA's files: set JAXRMP_DATA to the folder that holds lula/")
    golden = json.loads((folder / "golden_franka.json").read_text())
    loaded = load_lula(*(folder / golden[name] for name in ("urdf", "xrdf", "config")))

    def policy(target, q, qd):
        posture = np.array(golden["cspace_attractor"])
        tree = loaded.tree(frame=golden["frame"], position_target=target, cspace_target=posture, world=SCENE)
        return loaded.acceleration(tree, q, qd)

    arguments = np.array(golden["position_target"]), *arm_states(MANY)
    # Its projection is a loop, which batches do not write in C.
    assert_as_written(alone(policy), *arguments, rtol=1e-6, in_axes=(None, 0, 0), by_c=False)


def test_the_switch_keeps_programs_apart():
    x = np.ones((FEWEST, 3), np.float32)
    many = jax.jit(jax.vmap(Posture(np.zeros(3)).evaluate))

    def text():
        return many.lower(x, x).as_text()

    with machinery(False):
        off = text()
        many(x, x)
        with machinery(True):
            assert text() != off
    assert text() != off
    assert many._cache_size() == 1
    many(x, x)
    assert many._cache_size() == 2


def test_what_is_given_up_says_why(caplog):
    (part,) = report(jaxrmp.xla.one_loop(jnp.sort), np.zeros(3), batch=FEWEST)
    assert not part.taken_apart and part.reason == "holds `sort`"
    with caplog.at_level("INFO", "jaxrmp.xla"):
        call = jaxrmp.compiled(jnp.linalg.pinv, np.eye(2, dtype=np.float32))
    assert not call.one_kernel and call.reason and call.reason in caplog.text
    with machinery(False):
        assert "off" in jaxrmp.compiled(jnp.sin, np.ones(2)).reason
