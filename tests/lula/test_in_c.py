"""Lula's policies in C: their projection, a loop that ends by a condition, too."""

import numpy as np
import pytest

from jaxrmp import compiled, export
from jaxrmp.io import load_lula
from jaxrmp.world import Spheres, World

from ..export.calling import PRECISIONS, by_jax, compiled_c, in_precision, needs_compiler, of_type, within_rounding

MOST = 50  # steps of the projection
RNG = np.random.default_rng(0)


def states(count):
    middle = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    return middle + 0.2 * RNG.normal(size=(count, 7)), 0.3 * RNG.normal(size=(count, 7))


def policy_of(folder, golden):
    loaded = load_lula(*(folder / golden[name] for name in ("urdf", "xrdf", "config")))
    world = World(spheres=Spheres.of([((0.5, 0.1, 0.5), 0.05)], capacity=2))
    posture = np.array(golden["cspace_attractor"])

    def policy(target, q, qd):
        tree = loaded.tree(frame=golden["frame"], position_target=target, cspace_target=posture, world=world)
        return loaded.acceleration(tree, q, qd)

    return policy, float(loaded.max_acceleration_norm)


@needs_compiler
@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
@PRECISIONS
def test_in_c_as_by_jax(precision, folder, golden, tmp_path):
    with in_precision(precision):
        policy, most = policy_of(folder, golden)
        target, many = of_type(precision, np.array(golden["position_target"])), of_type(precision, states(10_000))
        found = export.c(policy, target, *(a[0] for a in many), max_iterations=MOST)
        (expected,) = by_jax(policy, (target,), many)
        qdd, hit = compiled_c(found, tmp_path)(target, *many)
        assert not hit.any() and len(found.source) < 1e6
        assert within_rounding([qdd], [expected], policy, precision, (target,), many)
    norms = np.linalg.norm(expected, axis=1)
    assert (norms > 0.99 * most).mean() > 0.5  # where the loop runs


@needs_compiler
@pytest.mark.filterwarnings("ignore::jaxrmp.FileWarning")
def test_from_python(folder, golden):
    policy, _ = policy_of(folder, golden)
    target, many = of_type("float", np.array(golden["position_target"])), of_type("float", states(50))
    call = compiled(policy, target, *(a[0] for a in many), backend="c", max_iterations=MOST)
    (expected,) = by_jax(policy, (target,), many)
    found = [call(target, q, qd) for q, qd in zip(*many, strict=True)]
    assert within_rounding([np.stack(found)], [expected], policy, "float", (target,), many)
