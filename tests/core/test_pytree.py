"""Frozen pytrees: what JAX sees of a value is what the value holds."""

import copy
import dataclasses
import pickle

import jax
import numpy as np

from jaxrmp import Translation
from jaxrmp._pytree import pytree, set_field, static


@pytree
class Pair:
    first: float
    second: float = 0.0
    name: str = static(default="pair")

    def __post_init__(self):
        seen = jax.tree.leaves(self)  # a check may look at the parameters before they are made uniform
        set_field(self, "first", 2 * seen[0])


def test_leaves_follow_a_field_that_is_set_after_they_were_looked_at():
    assert jax.tree.leaves(Pair(1.0, 3.0)) == [2.0, 3.0]


def test_a_changed_copy_has_leaves_of_its_own():
    pair = Pair(1.0)
    assert jax.tree.leaves(pair) == [2.0, 0.0]
    assert jax.tree.leaves(dataclasses.replace(pair, second=5.0)) == [4.0, 5.0]
    doubled = jax.tree.map(lambda x: 2 * x, pair)
    assert (jax.tree.leaves(doubled), doubled.first, doubled.name) == ([4.0, 0.0], 4.0, "pair")
    assert jax.tree.leaves(pair) == [2.0, 0.0]


def test_copies_by_copy_and_pickle_flatten_alike():
    task_map = Translation(np.arange(3.0))
    for again in (copy.deepcopy(task_map), pickle.loads(pickle.dumps(task_map))):
        for value in (again, task_map):
            (leaf,) = jax.tree.leaves(value)
            np.testing.assert_array_equal(leaf, np.arange(3.0))
        assert jax.tree.structure(again) == jax.tree.structure(task_map)


def test_static_fields_are_structure():
    assert jax.tree.structure(Pair(1.0)) == jax.tree.structure(Pair(2.0))
    assert jax.tree.structure(Pair(1.0)) != jax.tree.structure(Pair(1.0, name="other"))
    assert [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(Pair(1.0))] == [
        ".first",
        ".second",
    ]
