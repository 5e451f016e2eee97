"""Posture: a spring to a configuration."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, acceleration
from jaxrmp.leaves import Attractor, CruisingAttractor, Posture, StretchedAttractor

pytestmark = pytest.mark.usefixtures("x64")
REST = np.array([0.3, -0.4, 1.0])


def test_alone_it_is_a_damped_spring(assert_certified, assert_smooth, assert_single, traces_of):
    rng = np.random.default_rng(0)
    q, qd = rng.normal(size=(2, 1000, 3))
    leaf = Posture(REST, np.array([0.1, 1.0, 2.0]), 3.0, np.array([1.0, 2.0, 0.5]))
    expected = 3.0 * (REST - q[0]) - np.array([1.0, 2.0, 0.5]) * qd[0]
    np.testing.assert_allclose(acceleration(leaf, jnp.asarray(q[0]), jnp.asarray(qd[0])), expected, rtol=1e-12)
    np.testing.assert_allclose(leaf.energy(REST, 0 * REST), 0)
    assert_certified(leaf, q, qd)
    assert_smooth(leaf, np.stack([REST, q[0]]), np.stack([0 * REST, qd[0]]))
    assert_single(leaf, REST, REST)
    assert traces_of(leaf, jnp.asarray(REST)) == 1


@pytest.mark.parametrize("name", ["weight", "stiffness", "damping_rate"])
def test_bad_parameters_are_named(name):
    with pytest.raises(ConfigurationError, match=f"{name} of Posture is -1.0, expected a number that is not negative"):
        Posture(REST, **{name: -1.0})


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_a_leaf_is_drawn_to_must_be_finite(bad):
    place = np.array([0.0, bad, 0.0])
    for leaf, name in [
        (Posture, "rest"),
        (Attractor, "goal"),
        (CruisingAttractor, "goal"),
        (StretchedAttractor, "goal"),
    ]:
        with pytest.raises(ConfigurationError, match=rf"{name}\[1\] of {leaf.__name__} is {bad}, expected a finite"):
            leaf(place)
    assert jnp.isnan(jax.jit(lambda rest: Posture(rest).potential(jnp.zeros(3)))(jnp.asarray(place * np.nan))).all()
