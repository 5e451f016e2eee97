"""Where a learned metric counts: on all samples, not far away, and the identity there."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp.learning import support_of_samples
from jaxrmp.learning._metric_network import initial_cholesky_factor


def two_paths() -> np.ndarray:
    """Samples of two paths to the origin from opposite sides, [200, 3], m."""
    s = np.linspace(1, 0, 100)[:, None]
    return np.concatenate([s * [0.4, 0.1, 0.0], s * [-0.4, 0.1, 0.2]])


def test_it_is_nearly_one_on_every_path_and_vanishes_away_from_all():
    samples = two_paths()
    support = support_of_samples(samples, 0.05)
    assert support.anchors.shape == (64, 3)
    weight = jax.jit(jax.vmap(support))
    on = np.asarray(weight(jnp.asarray(samples)))
    assert np.quantile(on, 0.09) > 0.94 and on.min() > 0.8 and on.max() <= 1
    aside = np.asarray(weight(jnp.asarray(samples + [0.0, 0.0, 0.25])))
    assert aside[:50].max() < 0.01
    assert float(support(jnp.full(3, 50.0))) == 0
    slopes = jax.vmap(jax.grad(support))(jnp.asarray([*samples[::50], samples[0] + 9.0]))
    assert np.isfinite(np.asarray(slopes)).all()


def test_fewer_samples_than_anchors_are_all_anchors():
    support = support_of_samples(two_paths()[:5], 0.05)
    assert support.anchors.shape == (5, 3)


def test_a_factor_is_the_identity_where_its_support_ends():
    support = support_of_samples(two_paths(), 0.05)
    with_support = initial_cholesky_factor(jax.random.key(0), hidden=(8,), support=support)
    without = initial_cholesky_factor(jax.random.key(0), hidden=(8,))
    far, near = jnp.full(3, 3.0), jnp.asarray([0.2, 0.05, 0.0])
    np.testing.assert_array_equal(with_support(far), np.eye(3))
    assert np.abs(without(far) - np.eye(3)).max() > 0.01
    w = support(near)
    np.testing.assert_allclose(with_support(near), w * without(near) + (1 - w) * np.eye(3), rtol=1e-6, atol=1e-7)
