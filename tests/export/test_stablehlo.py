"""Policies as StableHLO: the same numbers, bit for bit, with and without jaxrmp."""

import json
from functools import partial

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrmp
from jaxrmp import ConfigurationError, UnknownNameError, acceleration
from jaxrmp._pytree import single
from jaxrmp._structure import structure_from_bytes, structure_to_bytes
from jaxrmp.cli import main
from jaxrmp.kinematics import panda, record_of
from jaxrmp.leaves import Damping
from jaxrmp.policies import reaching_policy, whole_arm_policy
from jaxrmp.world import Spheres, World
from jaxrmp.xla import machinery

pytest.importorskip("flatbuffers", reason="needs flatbuffers: pip install 'jaxrmp[export]'")

from jaxrmp.export import load_stablehlo, stablehlo, write_stablehlo

Q = np.array([0.1, -0.6, 0.2, -2.0, 0.1, 1.6, 0.7], np.float32)
QD = np.linspace(-0.2, 0.3, 7, dtype=np.float32)

PLAIN = """
import importlib.util, json, sys
import jax, jax.export, numpy as np
assert importlib.util.find_spec("jaxrmp") is None
run = jax.export.deserialize(bytearray(open(sys.argv[1], "rb").read())).call
found = [run(*(np.array(a, np.float32) for a in arguments)) for arguments in json.loads(sys.argv[2])]
print(json.dumps([np.asarray(f).view(np.int32).tolist() for f in found]))
"""


def as_written(function, *arguments):
    with machinery(False):
        return np.asarray(jax.jit(function)(*arguments))


def moved(skill):
    T = np.array(skill.T_world_object, np.float32)
    T[:3, 3] += [0.05, -0.03, 0.02]
    return T


def test_a_skill_is_the_same_bit_for_bit_where_only_jax_is_installed(run_jax, drawer_skill, learned_drawer, tmp_path):
    file = tmp_path / "drawer.stablehlo"
    assert main(["export", str(learned_drawer / "drawer_closing.skill.npz"), "--stablehlo", str(file)]) == 0
    states = [(Q, QD, np.asarray(drawer_skill.T_world_object)), (Q + QD, 0 * QD, moved(drawer_skill))]
    found = run_jax(PLAIN, file, json.dumps([[a.tolist() for a in state] for state in states]))
    arm = whole_arm_policy(drawer_skill, panda())
    policy = lambda q, qd, T: acceleration(arm.tree(T, World()), q, qd)  # noqa: E731
    same = jax.export.deserialize(bytearray(file.read_bytes())).call
    here = [np.asarray(same(*state)) for state in states]
    np.testing.assert_array_equal(np.array(found, np.int32), [qdd.view(np.int32) for qdd in here])
    np.testing.assert_allclose(here, [as_written(policy, *state) for state in states], rtol=1e-4, atol=1e-4)
    assert np.abs(here[0] - here[1]).max() > 0.1


def whole(policy, T, world, q, qd):
    return {"qdd": acceleration(policy.tree(T, world), q, qd), "world": world}


def test_a_policy_and_its_world_are_arguments_and_results(tmp_path):
    policy, T = reaching_policy(panda(), "panda_hand_tcp"), np.eye(4, dtype=np.float32)
    world = World(spheres=Spheres.of([((0.5, 0.0, 0.5), 0.05)], capacity=2))
    file = write_stablehlo(tmp_path / "whole.stablehlo", whole, policy, T, world, Q, QD)
    run, again = load_stablehlo(file), load_stablehlo(file.read_bytes())
    for state in ((Q, QD), (Q + QD, 0 * QD)):
        found = run(policy, T, world, *state)
        with machinery(False):
            here = jax.jit(whole)(policy, T, world, *state)
        assert jax.tree.structure(found) == jax.tree.structure(here)
        for a, b in zip(*(jax.tree.leaves(each) for each in (found, again(policy, T, world, *state))), strict=True):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_allclose(found["qdd"], here["qdd"], rtol=1e-4, atol=1e-4)  # which XLA fuses otherwise
        np.testing.assert_array_equal(found["world"].spheres.radius, here["world"].spheres.radius)


def test_jax_itself_writes_a_skill_and_a_world():
    def tell(leaf, world):
        return jax.tree.map(jnp.sum, (leaf, world))

    exported = jax.export.export(jax.jit(tell))(Damping(), World())
    again = jax.export.deserialize(exported.serialize())
    assert again.in_tree == exported.in_tree and again.out_tree == exported.out_tree


def test_what_a_policy_holds_may_be_numpy_arrays(drawer_skill):
    tree = single(drawer_skill.tree(panda()))
    found = load_stablehlo(stablehlo(partial(acceleration, tree), Q, QD))(Q, QD)
    np.testing.assert_allclose(found, as_written(acceleration, tree, Q, QD), rtol=1e-4, atol=1e-4)


def test_nothing_outside_is_called(drawer_skill):
    tree = drawer_skill.tree(panda())
    batch = jax.vmap(partial(acceleration, tree))
    q = np.tile(Q, (64, 1))
    text = jax.export.deserialize(bytearray(stablehlo(batch, q, q))).mlir_module()
    assert "stablehlo.dot_general" in text and "custom_call" not in text


def test_a_program_may_be_for_several_platforms():
    content = stablehlo(lambda q: 2 * q, Q, platforms=("cpu", "cuda"))
    assert jax.export.deserialize(bytearray(content)).platforms == ("cpu", "cuda")
    with pytest.raises(UnknownNameError, match="unknown platform 'gpu'.*Valid: cpu, cuda"):
        stablehlo(lambda q: 2 * q, Q, platforms=("gpu",))


def test_structure_comes_back_equal(drawer_skill):
    record = record_of(panda())
    for structure in (
        (),
        ("name", 1, 2.5, True, None, (1, (2,))),
        (float("inf"), -float("inf"), 0.1, np.float32(0.1)),
        (record.model, record),
        (drawer_skill.configuration,),
        jax.tree.structure(drawer_skill).node_data()[1],
    ):
        again = structure_from_bytes(structure_to_bytes(structure))
        assert again == structure and type(again) is type(structure)
        if structure and structure[0] is record.model:
            assert again[0].fingerprint == record.model.fingerprint and hash(again) == hash(structure)


def test_what_cannot_be_written_or_read_is_an_error(tmp_path):
    @jaxrmp.pytree
    class Holds:
        gain: float
        function: object = jaxrmp.static()

    with pytest.raises(ConfigurationError, match="a static field holds .*of type builtin_function_or_method"):
        stablehlo(lambda h: h.gain, Holds(1.0, len))
    with pytest.raises(ConfigurationError, match="cannot be written: .*unregistered type.*Partial"):
        stablehlo(lambda f: 1.0, jax.tree_util.Partial(len))
    for odd in (b"", b"no program", Q.tobytes()):
        with pytest.raises(ConfigurationError, match="the content is no program"):
            load_stablehlo(odd)
    with pytest.raises(ConfigurationError, match="os:path is no class that is there"):
        structure_from_bytes(b'{"of": "os:path", "fields": {}}')
    with pytest.raises(ConfigurationError, match=r"Body has .*parent.*, but the file \['name'\]"):
        structure_from_bytes(b'{"of": "jaxrmp.kinematics._robot:Body", "fields": {"name": "hand"}}')


def test_a_class_may_be_defined_again():
    def made():
        @jaxrmp.pytree
        class Again:
            gain: float

        return Again

    first, second = made(), made()
    content = stablehlo(lambda a: 2 * a.gain, first(1.5))
    assert load_stablehlo(content)(first(2.0)) == 4.0
    assert jax.jit(lambda a: 2 * a.gain)(second(2.0)) == 4.0
