"""Formation: a distance kept, to a fixed point and between two points that move."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import ConfigurationError, Distance, compose, pullback
from jaxrmp.leaves import Damping, Formation
from jaxrmp.simulation import rollout

pytestmark = pytest.mark.usefixtures("x64")
CENTER = np.array([0.3, -0.2, 0.5])


def test_force_metric_and_certificate(assert_certified, assert_smooth, assert_single, traces_of):
    leaf = Formation(weight=2.0, gain=3.0, damping_rate=0.5)
    x, xd = jnp.array([0.4, -0.1]), jnp.array([-1.0, 2.0])
    form = leaf(x, xd)
    np.testing.assert_allclose(form.f, -3.0 * 2.0 * x - 0.5 * 2.0 * xd, rtol=1e-14)
    np.testing.assert_allclose(form.M, 2 * np.eye(2), rtol=1e-14)
    q, qd = np.random.default_rng(0).normal(size=(2, 1000, 3))
    assert_certified(pullback(Distance(CENTER, 0.7), leaf) + Damping(0.1), q, qd)
    assert_smooth(leaf, np.zeros((1, 2)), np.zeros((1, 2)))
    assert_single(leaf, x, xd)
    assert traces_of(leaf, x) == 1


def test_at_the_centre_and_at_the_distance_it_is_finite(assert_smooth):
    tree = pullback(Distance(jnp.asarray(CENTER), 0.7), Formation())
    x = np.stack([CENTER, CENTER + np.array([0.7, 0.0, 0.0])])
    for speed in (0.0, 1.0):
        assert_smooth(tree, x, np.full_like(x, speed))
    assert np.all(tree(jnp.asarray(CENTER), jnp.ones(3)).f == 0)


def test_two_points_come_to_their_distance():
    apart = compose(Partial(lambda x: x[:3] - x[3:]), Distance(jnp.zeros(3), 0.5))
    tree = pullback(apart, Formation(gain=9.0, damping_rate=6.0)) + Damping(0.01, 1.0)
    path = jax.jit(lambda tree: rollout(tree, jnp.array([0.0, 0, 0, 1, 1, 0]), duration=5.0, dt=0.01))(tree)
    np.testing.assert_allclose(np.linalg.norm(path.q[-1, :3] - path.q[-1, 3:]), 0.5, atol=1e-3)
    np.testing.assert_allclose(path.q[-1, :3] + path.q[-1, 3:], [1, 1, 0], atol=1e-9)  # equal and opposite


@pytest.mark.parametrize("name", ["weight", "gain", "damping_rate"])
def test_bad_parameters_are_named(name):
    with pytest.raises(
        ConfigurationError, match=f"{name} of Formation is -1.0, expected a number that is not negative"
    ):
        Formation(**{name: -1.0})
