"""What a policy gives in C is what JAX gives, state after state; and what has no form in C says so."""

import subprocess
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrmp
from jaxrmp import acceleration, export, pytree
from jaxrmp.leaves import Damping, Posture
from jaxrmp.world import Spheres, World
from jaxrmp.xla import layout

from ..xla.examples import LEAVES, MAPS, RNG, of_leaf, of_map, tree_24_pairs
from .calling import MANY, PRECISIONS, STRICT, apart, assert_c_is_jax, by_jax, compiled_c, needs_compiler, packed


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


GOAL = np.array([0.45, 0.35, 0.45])
ARM = arm_states(5 * MANY)


@needs_compiler
@PRECISIONS
def test_whole_policy_of_24_pairs(precision, tmp_path):
    assert_c_is_jax(policy_24_pairs, precision, tmp_path, (GOAL,), *ARM)


@needs_compiler
def test_obstacles_with_their_mask(tmp_path):
    """Whatever is inactive, or no number, is as if it were not there; fields are named after arguments and arrays."""
    goal = np.zeros(3, np.float32)

    def distances(world, p):
        return {"distance": world.signed_distance(p), "active": world.active, "count": jnp.sum(world.active)}

    world = World(spheres=Spheres.of([((0, 0, 2), 0.5), ((1, 0, 0), 0.25)], capacity=4))
    world = jax.tree.map(lambda a: np.asarray(a, bool if np.asarray(a).dtype == bool else np.float32), world)
    found = export.c(distances, world, goal, units={"p": "m", "world": "m", "count": "of them"})
    assert [f.name for f in found.inputs] == [f"world_spheres_{n}" for n in ("center", "radius", "active")] + ["p"]
    assert "int32_t count; /* of them */" in found.header and "float p[3]; /* m */" in found.header
    given = jax.tree.map(lambda a: np.stack([a] * 3), world)
    given.spheres.center[1, 0, 2] = np.nan
    given.spheres.active[2, 1] = False
    p = RNG.normal(size=(3, 3)).astype(np.float32)
    results = compiled_c(found, tmp_path)(given, p)
    for a, b in zip(results, jax.tree.leaves(jax.vmap(distances)(given, p)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6)
    assert results[1].tolist() == [2, 1, 1]


@needs_compiler
@pytest.mark.parametrize("flags", ["-O2 -ffp-contract=off", "-O3 -march=native", "-O0 -pedantic"])
def test_large_arrays_however_it_is_compiled(flags, tmp_path):
    weights = RNG.normal(size=(4, 70, 33)).astype(np.float32)

    def function(x, k):
        y = jnp.tanh(weights[0] @ x[:33]) + jnp.exp(-((weights[1] @ x[-33:]) ** 2))
        A = jnp.einsum("nij,nkj->nik", weights[:, :10] * y[:10, None], weights[:, 5:10])
        return y, A @ A.swapaxes(1, 2), jax.nn.softmax(x), x[::-1] * k, jnp.where(x > 0, k, -k), jnp.max(x)

    x, k = RNG.normal(size=(50, 70)).astype(np.float32), np.arange(50, dtype=np.int32)
    found = export.c(function, x[0], k[0])
    assert apart(compiled_c(found, tmp_path, flags)(x, k), by_jax(function, (), (x, k))) < 2e-5


_BY_FILE = """
#include <stdio.h>
#include "policy.h"
int main(int count, char **names) {
    static policy_in in; static policy_out out;
    FILE *from = count == 3 ? fopen(names[1], "rb") : 0, *to = from ? fopen(names[2], "wb") : 0;
    if (!to) return 1;
    while (fread(&in, sizeof in, 1, from)) { policy(&in, &out); fwrite(&out, sizeof out, 1, to); }
    return fclose(to) || fclose(from);
}
"""


@needs_compiler
def test_sanitizers_find_nothing(tmp_path):
    goal, all_states = GOAL.astype(np.float32), [a.astype(np.float32) for a in ARM]
    states = [a[:300].copy() for a in all_states]
    states[0][7, 2], states[1][9] = np.nan, 1e30
    found = export.c(policy_24_pairs, goal, states[0][0], states[1][0])
    source, _ = found.write(tmp_path)
    (tmp_path / "by_file.c").write_text(_BY_FILE)
    flags = f"{STRICT} -O1 -g -fsanitize=undefined,address -fno-sanitize-recover=all"
    command = ["gcc", *flags.split(), str(source), str(tmp_path / "by_file.c"), "-o", str(tmp_path / "run"), "-lm"]
    subprocess.run(command, check=True)
    (tmp_path / "in").write_bytes(packed(found, goal, *states).tobytes())
    ran = subprocess.run(["./run", "in", "out"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 0 and not ran.stderr, ran.stderr
    results = np.frombuffer((tmp_path / "out").read_bytes(), layout(found.outputs))["result"]
    fine = np.setdiff1d(np.arange(300), [7, 9])
    expected = by_jax(policy_24_pairs, (goal,), all_states)[0]  # as compiled above
    assert np.isnan(results[7]).all() and apart([results[fine]], [expected[fine]]) < 1e-3


@pytree
class Sorted(jaxrmp.Leaf):
    name = "sorted"

    def __call__(self, x, xd):
        return Damping()(x, jnp.sort(xd))


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda q, qd: acceleration(Posture(q) + Sorted(), q, qd), "holds `sort`, in Sorted.__call__ "),
        (lambda q, qd: jax.lax.while_loop(lambda x: x[0] < 1, lambda x: 2 * x, q), "holds `while`, in .*<lambda>"),
        (lambda q, qd: q[jnp.argmax(qd)], "holds `argmax`"),
        (lambda q, qd: (q.astype(jnp.float16) * 2).astype(jnp.float32), "float16"),
        (lambda q, qd: q[:0], "gives no numbers"),
        (lambda q, qd: jnp.sin(jnp.arange(300_000, dtype=q.dtype) * q[0]) * 2, "bytes of working memory"),
    ],
)
def test_what_has_no_form_in_c_says_so_and_where(function, message):
    q = np.zeros(3, np.float32)
    with pytest.raises(jaxrmp.ExportError, match=message):
        export.c(function, q, q)


def test_names_that_do_not_fit():
    q = np.zeros(3, np.float32)
    with pytest.raises(jaxrmp.ConfigurationError, match="names is .'q',., expected one for each of 2 examples"):
        export.c(lambda q, qd: q + qd, q, q, names=["q"])
    with pytest.raises(jaxrmp.ConfigurationError, match="expected each once"):
        export.c(lambda q, qd: q + qd, q, q, names=["q", "q"])
    with pytest.raises(jaxrmp.ConfigurationError, match="two arrays are called 'a_b_c'"):
        export.c(lambda a: a["b"]["c"] + a["b_c"], {"b": {"c": q}, "b_c": q})
    found = export.c(lambda a: a * 2, q, names=["double"], name="my policy")
    assert found.name == "my_policy" and found.inputs[0].name == "double_"


@needs_compiler
@pytest.mark.parametrize("name", ["sin", "floor", "main", "R", "LAST", "rounded_"])
def test_names_that_c_has_already_are_changed(name, tmp_path):
    q = np.linspace(-1, 1, 3).astype(np.float32)
    found = export.c(
        lambda a: jnp.sin(a) + jnp.floor(a), q, names=["NAN"], name=name, units={"NAN": "*/ m"}, about="*/"
    )
    assert apart(compiled_c(found, tmp_path)(q[None]), [np.sin(q[None]) + np.floor(q[None])]) < 1e-6


@needs_compiler
def test_products_of_whole_numbers(tmp_path):
    def function(x):
        i = (x > 0).astype(jnp.int32).reshape(20, 20)
        return i @ i

    x = RNG.normal(size=(5, 400)).astype(np.float32)
    found = export.c(function, x[0])
    np.testing.assert_array_equal(compiled_c(found, tmp_path)(x)[0], jax.vmap(function)(x))


def test_more_memory_than_a_stack_has_is_refused():
    x = np.zeros(1_000_000, np.float32)
    with pytest.raises(jaxrmp.ExportError, match="bytes of working memory, more than 1,048,576"):
        export.c(lambda x: jnp.max(jnp.sin(x)) * jnp.sin(x[::-1]), x)


def test_the_fingerprint_tells_apart_what_computes_something_else():
    q = np.zeros(3, np.float32)
    one, same, other = (export.c(lambda q, qd, k=k: acceleration(Posture(q + k), q, qd), q, q) for k in (1.0, 1.0, 1.5))
    assert one.fingerprint == same.fingerprint != other.fingerprint and one.fingerprint in one.header
    assert one.source == same.source


def test_nothing_is_half_written(tmp_path, monkeypatch):
    q = np.zeros(3, np.float32)
    found = export.c(lambda q: 2 * q, q)
    (tmp_path / "policy.c").write_text("before")
    with monkeypatch.context() as full:
        full.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError("no space left")))
        with pytest.raises(OSError, match="no space left"):
            found.write(tmp_path)
    assert [f.name for f in tmp_path.iterdir()] == ["policy.c"] and (tmp_path / "policy.c").read_text() == "before"
    assert [f.name for f in found.write(tmp_path)] == ["policy.c", "policy.h"]
    assert (tmp_path / "policy.c").read_text() == found.source
