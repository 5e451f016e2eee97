"""The metric network and its training, on fields whose metric is known."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn

from jaxrmp import ConfigurationError, TrainingError, UnknownNameError
from jaxrmp.learning import support_of_samples
from jaxrmp.learning._metric_network import ACTIVATIONS, cholesky_shapes, initial_cholesky_factor
from jaxrmp.learning._metric_training import field_loss, train_metrics

SMALL = dict(hidden=(16, 8), updates=50)


@pytest.mark.parametrize(("activation", "m"), [*((name, 3) for name in ACTIVATIONS), ("relu", 1)])
def test_a_factor_starts_at_the_identity(activation, m):
    factor = initial_cholesky_factor(jax.random.key(m), m, activation=activation, length_scale=0.5)
    x = jax.random.uniform(jax.random.key(1), (50, m), minval=-0.5, maxval=0.5)
    L = np.asarray(jax.jit(jax.vmap(factor))(x))
    assert L.shape == (50, m, m)
    # The last layer's weights are drawn with deviation 0.01; over 64 units that is 0.05 to 0.1, at the box's edge 0.25.
    deviation = L - np.eye(m)
    assert np.abs(deviation).max() < 0.25 and np.sqrt(np.mean(deviation**2)) < 0.08


def test_a_factor_is_lower_triangular_with_its_diagonal_above_the_offset_whatever_the_weights():
    offset = 0.2
    factor = initial_cholesky_factor(jax.random.key(0), 3, (16, 8), offset=offset)
    rng = np.random.default_rng(0)
    wild = jax.tree.map(lambda a: jnp.asarray(rng.normal(scale=2.0, size=jnp.shape(a)), a.dtype), factor.weights)
    L = np.asarray(jax.jit(jax.vmap(replace(factor, weights=wild)))(rng.normal(size=(200, 3))))
    assert (np.triu(L, 1) == 0).all()
    diagonal = np.diagonal(L, axis1=1, axis2=2)
    assert (diagonal >= offset).all() and diagonal.min() < offset + 0.5
    assert np.abs(L - L[0]).max() > 1  # it does depend on the position


@pytest.mark.parametrize(("activation", "m"), [*((name, 3) for name in ACTIVATIONS), ("tanh", 1)])
def test_the_network_is_the_one_that_flax_has(activation, m):
    hidden, offset = (16, 8), 0.2
    factor = initial_cholesky_factor(jax.random.key(0), m, hidden, activation, offset)
    shapes = jax.tree.map(jnp.shape, factor.weights)
    assert shapes == cholesky_shapes(m, hidden)
    rng = np.random.default_rng(0)
    wild = jax.tree.map(lambda a: jnp.asarray(rng.normal(size=a.shape), a.dtype), factor.weights)

    class Layers(nn.Module):
        @nn.compact
        def __call__(self, x):
            for width in hidden:
                x = getattr(nn, activation)(nn.Dense(width, precision="highest")(x))
            diagonal = nn.Dense(m, precision="highest")(x)
            below = nn.Dense(m * (m - 1) // 2, precision="highest", kernel_init=nn.initializers.zeros)(x)
            return jnp.abs(diagonal) + offset, below

    x = jnp.asarray(rng.normal(size=(50, m)), jnp.float32)
    diagonal, below = Layers().apply({"params": wild}, x)
    L = jax.vmap(replace(factor, weights=wild))(x)
    np.testing.assert_allclose(jnp.diagonal(L, axis1=1, axis2=2), diagonal, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(L[:, *np.tril_indices(m, -1)], below, rtol=1e-5, atol=1e-5)


def test_positions_are_divided_by_the_length_scale():
    factor = initial_cholesky_factor(jax.random.key(0), 2, (16,), length_scale=0.1)
    unit = initial_cholesky_factor(jax.random.key(0), 2, (16,))
    x = jnp.asarray([0.03, -0.05])
    np.testing.assert_allclose(factor(x), unit(10 * x), rtol=1e-6)
    assert not np.allclose(factor(x), unit(x), atol=1e-6)


def test_an_unknown_activation_or_loss_is_named():
    with pytest.raises(UnknownNameError, match="unknown activation 'rellu'. Did you mean 'relu'.*softplus, silu, tanh"):
        initial_cholesky_factor(jax.random.key(0), activation="rellu")
    x = jnp.ones((1, 4, 2))
    with pytest.raises(UnknownNameError, match="unknown loss 'l3'.*smooth_l1, l2"):
        train_metrics(x, x, x, loss="l3")  # type: ignore[arg-type]


def subtasks(K=2, N=100, m=3, seed=0):
    """Fields `-M_k^-1 slope` of constant metrics M_k."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-0.5, 0.5, (K, N, m))
    slope = rng.normal(size=(K, N, m))
    slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
    L = np.tril(0.5 * rng.normal(size=(K, m, m)), -1) + np.apply_along_axis(np.diag, 1, rng.uniform(0.8, 1.6, (K, m)))
    M = L @ np.swapaxes(L, -1, -2)
    velocity = -np.linalg.solve(M[:, None], slope[..., None])[..., 0]
    return M, *(jnp.asarray(a, jnp.float32) for a in (x, slope, velocity))


def test_losses_are_their_formulas_and_vanish_for_the_true_metric():
    M, x, slope, velocity = subtasks(1)
    factor = initial_cholesky_factor(jax.random.key(0), 3, (8,))
    L = jax.jit(jax.vmap(factor))(x[0])
    M_here = np.asarray(L @ jnp.swapaxes(L, -1, -2), float)
    error = -np.linalg.solve(M_here, np.asarray(slope[0], float)[..., None])[..., 0] - velocity[0]
    np.testing.assert_allclose(field_loss(L, slope[0], velocity[0], "l2"), np.mean(np.sum(error**2, -1)), rtol=1e-4)
    huber = np.where(np.abs(error) < 0.1, 0.5 * error**2, 0.1 * (np.abs(error) - 0.05))
    np.testing.assert_allclose(field_loss(L, slope[0], velocity[0]), np.mean(np.sum(huber, -1)), rtol=1e-4)
    true = jnp.broadcast_to(jnp.asarray(np.linalg.cholesky(M[0]), jnp.float32), L.shape)
    assert field_loss(true, slope[0], velocity[0], "l2") < 1e-10


def test_training_sees_the_support():
    _, x, slope, velocity = subtasks()
    near = [support_of_samples(np.asarray(points[:20]), 0.1, 8) for points in x]
    support = jax.tree.map(lambda *parts: jnp.stack([jnp.asarray(part, jnp.float32) for part in parts]), *near)
    fit = train_metrics(x, slope, velocity, updates=3, hidden=SMALL["hidden"], support=support)
    first = train_metrics(
        x, slope, velocity, updates=1, hidden=SMALL["hidden"], support=support, learning_rate=1e-20
    ).factors
    L = jax.jit(jax.vmap(jax.vmap(lambda factor, x: factor(x), (None, 0))))(first, x)
    np.testing.assert_allclose(fit.losses[0], jax.jit(jax.vmap(field_loss))(L, slope, velocity), rtol=1e-5)


def test_training_takes_float64_where_that_is_on():
    _, *given = subtasks(N=20)
    with jax.enable_x64(True):
        fit = train_metrics(*(np.asarray(a, np.float64) for a in given), updates=2, hidden=(8,))
        assert np.isfinite(fit.losses).all()


@pytest.mark.parametrize("loss", ["smooth_l1", "l2"])
def test_constant_metrics_are_learned(loss):
    M, x, slope, velocity = subtasks()
    fit = train_metrics(x, slope, velocity, updates=400, hidden=(32, 16), learning_rate=0.01, loss=loss)
    assert fit.losses.shape == (400, 2)
    assert (fit.losses[-1] < 1e-3).all() and (fit.losses[-1] < 0.01 * fit.losses[0]).all()
    for k in range(2):
        factor = jax.tree.map(lambda a, k=k: a[k], fit.factors)
        L = np.asarray(jax.jit(jax.vmap(factor))(x[k]))
        np.testing.assert_allclose((L @ np.swapaxes(L, -1, -2)).mean(0), M[k], atol=0.05)


def test_subtasks_are_independent_and_training_is_deterministic_by_seed():
    _, x, slope, velocity = subtasks()
    first, again = (train_metrics(x, slope, velocity, seed=3, **SMALL) for _ in range(2))
    np.testing.assert_array_equal(first.losses, again.losses)
    for a, b in zip(jax.tree.leaves(first.factors), jax.tree.leaves(again.factors), strict=True):
        np.testing.assert_array_equal(a, b)

    changed = train_metrics(x, slope, velocity.at[1].multiply(0.5), seed=3, **SMALL)
    np.testing.assert_array_equal(changed.losses[:, 0], first.losses[:, 0])
    assert (changed.losses[:, 1] != first.losses[:, 1]).all()

    other = train_metrics(x, slope, velocity, seed=4, **SMALL)
    assert (other.losses[0] != first.losses[0]).all()


def test_progress_is_reported_up_to_the_last_update():
    _, x, slope, velocity = subtasks()
    calls = []
    fit = train_metrics(
        x, slope, velocity, hidden=SMALL["hidden"], updates=120, progress=lambda done, loss: calls.append((done, loss))
    )
    done, losses = zip(*calls, strict=True)
    assert list(done) == sorted(done) and done[-1] == 120 and len(done) > 1
    np.testing.assert_allclose(losses, fit.losses.mean(axis=1)[np.asarray(done) - 1], rtol=1e-6)


def test_training_that_diverges_is_an_error():
    _, x, slope, velocity = subtasks()
    with pytest.raises(TrainingError, match=r"not finite after 50 updates \(learning rate 1e\+30\)"):
        train_metrics(x, slope, velocity, hidden=SMALL["hidden"], updates=50, learning_rate=1e30)
    with pytest.raises(TrainingError, match="not finite"):
        train_metrics(x, slope, velocity.at[0, 3, 1].set(jnp.nan), hidden=SMALL["hidden"], updates=50)


def test_no_updates_are_refused():
    x = jnp.zeros((1, 4, 3))
    with pytest.raises(ConfigurationError, match="updates is 0, expected at least 1"):
        train_metrics(x, x, x, updates=0)
