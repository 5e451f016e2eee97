"""The joint velocity limit: its formula, its law, and that no pull takes a joint over it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError
from jaxrmp.leaves import Attractor, Damping, JointVelocityLimit
from jaxrmp.simulation import rollout

pytestmark = pytest.mark.usefixtures("x64")

LIMIT = np.array([2.0, 0.5, np.inf])


def test_it_is_its_formula_and_not_felt_below_its_onset():
    leaf = JointVelocityLimit(LIMIT, weight=0.3, damping_rate=15.0, onset=0.6)
    qd = np.array([1.7, -0.4, 30.0])
    form = leaf(jnp.zeros(3), jnp.asarray(qd))
    e = (np.abs(qd[:2]) / LIMIT[:2] - 0.6) / 0.4
    G = 0.3 * (e / (1 - e)) ** 2
    slope = 0.3 * 2 * e / (1 - e) ** 3 / (0.4 * LIMIT[:2]) * np.sign(qd[:2])
    np.testing.assert_allclose(form.M, np.diag([*(G + 0.5 * qd[:2] * slope), 0.0]), rtol=1e-12)
    np.testing.assert_allclose(form.f, [*(-15 * G * qd[:2]), 0.0], rtol=1e-12)
    below = leaf(jnp.zeros(3), jnp.asarray([1.19, -0.29, 5.0]))
    assert not np.any(below.M) and not np.any(below.f)


def test_certificate_below_at_and_above_the_limit(assert_certified, assert_single):
    rng = np.random.default_rng(0)
    x, xd = rng.normal(size=(1000, 2)), rng.uniform(-3, 3, (1000, 2))
    assert_certified(JointVelocityLimit(np.array([2.0, 0.5])) + Damping(0.01), x, xd)
    assert_single(JointVelocityLimit(2.0), np.ones(2), np.array([1.9, -5.0]))


def test_smooth_at_rest_at_the_onset_and_at_the_limit(assert_smooth):
    xd = np.array([0.0, 1.4, -1.4, 1.9, 2.0, -2.5])[:, None]
    assert_smooth(JointVelocityLimit(2.0), np.zeros_like(xd), xd)


@jax.jit
def highest_speed(tree):
    return jnp.abs(rollout(tree, jnp.zeros(1), duration=1.0, dt=1e-3).qd).max()


@pytest.mark.parametrize("pull", [1.0, 100.0, 250.0])
def test_no_pull_takes_a_joint_over_its_limit(pull):
    """In steps of a millisecond none of which can jump the last stretch, from the onset to the limit."""
    tree = Attractor(jnp.array([50.0]), weight_near=1.0, gain=pull, damping_rate=0.1) + Damping(0.05)
    speeds = {}
    for name, node in (("free", tree), ("limited", tree + JointVelocityLimit(1.0))):
        speeds[name] = float(highest_speed(node))
    assert speeds["limited"] < 1.0
    assert pull == 1.0 or speeds["free"] > 2.0


def test_no_retrace(traces_of):
    assert traces_of(JointVelocityLimit(2.0, onset=0.3), jnp.array([0.01])) == 1


def test_bad_parameters_are_named():
    for name, value, wording in (
        ("limit", 0.0, "a positive number"),
        ("weight", -1.0, "a number that is not negative"),
        ("onset", 1.0, "a number below one"),
    ):
        with pytest.raises(ConfigurationError, match=f"{name} of JointVelocityLimit is {value}, expected {wording}"):
            JointVelocityLimit(**{"limit": 1.0, name: value})
