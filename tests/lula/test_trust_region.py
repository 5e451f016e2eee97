"""Resolving inside a bound, against SciPy's root finder."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from jaxrmp import ConfigurationError, NaturalForm
from jaxrmp._trust_region import resolve_within


def random_form(rng, n, spread):
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    M = Q @ np.diag(10.0 ** rng.uniform(-spread, spread, n)) @ Q.T
    return 10.0 ** rng.uniform(-2, 6) * rng.normal(size=n), (M + M.T) / 2


def by_root_finder(f, M, bound):
    def excess(shift):
        return np.linalg.norm(np.linalg.solve(M + shift * np.eye(len(f)), f)) - bound

    if excess(0.0) <= 0:
        return np.linalg.solve(M, f)
    shift = brentq(excess, 0.0, np.linalg.norm(f) / bound, xtol=1e-14, rtol=1e-15)
    return np.linalg.solve(M + shift * np.eye(len(f)), f)


def test_it_solves_the_secular_equation():
    rng = np.random.default_rng(0)
    with jax.enable_x64(True):
        forms = [random_form(rng, 6, 3) for _ in range(200)]
        f, M = (np.stack(part) for part in zip(*forms, strict=True))
        found = jax.jit(jax.vmap(lambda f, M: resolve_within(NaturalForm(f, M), 5.0, 1e-9)))(f, M)
    expected = np.stack([by_root_finder(*form, 5.0) for form in forms])
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    bounded = np.linalg.norm(expected, axis=1) > 5 - 1e-6
    assert 20 < bounded.sum() < 195  # both cases are in the sample
    assert np.linalg.norm(found, axis=1).max() <= 5 + 1e-8


def test_the_tolerance_is_kept_and_bettered_by_the_last_step():
    rng = np.random.default_rng(1)
    forms = [random_form(rng, 7, 2) for _ in range(100)]
    f, M = (np.stack(part).astype(np.float32) for part in zip(*forms, strict=True))
    found = jax.jit(jax.vmap(lambda f, M: resolve_within(NaturalForm(f, M), 50.0, 0.01)))(f, M)
    assert found.dtype == jnp.float32
    assert np.linalg.norm(found, axis=1).max() <= 50.01


def test_inside_the_bound_nothing_is_changed():
    with jax.enable_x64(True):
        f, M = random_form(np.random.default_rng(2), 4, 1)
        bound = 1.01 * np.linalg.norm(np.linalg.solve(M, f))
        found = resolve_within(NaturalForm(jnp.array(f), jnp.array(M)), bound, 1e-9)
    np.testing.assert_allclose(found, np.linalg.solve(M, f), rtol=1e-10)


@pytest.mark.parametrize("bound", [1e3, 2.0], ids=["inside", "bounded"])
def test_its_gradient_is_that_of_the_root(bound):
    with jax.enable_x64(True):
        f, M = random_form(np.random.default_rng(3), 4, 1)
        f, direction = f / np.linalg.norm(f) * 20, np.array([1.0, -2.0, 0.5, 0.3])
        bound *= np.linalg.norm(np.linalg.solve(M, f)) / 10

        def along(t, bound=bound):
            return resolve_within(NaturalForm(jnp.array(f + t * direction), M * (1 + 0.3 * t)), bound, 1e-10)

        step = 1e-5
        numeric = (np.asarray(along(step)) - np.asarray(along(-step))) / (2 * step)
        _, forward = jax.jvp(along, (0.0,), (1.0,))
        backward = jax.jacrev(along)(0.0)
    np.testing.assert_allclose(forward, numeric, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(backward, forward, rtol=1e-9)


def test_the_bound_itself_is_differentiable():
    with jax.enable_x64(True):
        form = NaturalForm(jnp.array([30.0, 10.0]), jnp.diag(jnp.array([2.0, 1.0])))
        slope = jax.grad(lambda bound: jnp.linalg.norm(resolve_within(form, bound, 1e-10)))(3.0)
    np.testing.assert_allclose(slope, 1.0, rtol=1e-9)


def test_at_rest_the_gradient_is_finite():
    def energy(f):
        return jnp.sum(resolve_within(NaturalForm(f, jnp.eye(3)), 1.0, 1e-6) ** 2)

    assert np.isfinite(jax.grad(energy)(jnp.zeros(3))).all()


def test_a_singular_metric_is_resolved_where_its_force_exceeds_the_bound():
    with jax.enable_x64(True):
        form = NaturalForm(jnp.array([100.0, 50.0, 10.0]), jnp.diag(jnp.array([1.0, 1.0, 0.0])))
        found = resolve_within(form, 5.0, 1e-9)
    np.testing.assert_allclose(np.linalg.norm(found), 5.0, rtol=1e-9)


@pytest.mark.parametrize(("bound", "tolerance", "message"), [(0.0, 1e-2, "max_norm.* is 0.0"), (1.0, -1, "tolerance")])
def test_a_bound_that_is_none_is_refused(bound, tolerance, message):
    with pytest.raises(ConfigurationError, match=f"{message}.*expected a positive number"):
        resolve_within(NaturalForm(jnp.ones(2), jnp.eye(2)), bound, tolerance)
