"""Geometric dynamical systems against published formulas, and their certificate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import GeometricDynamicalSystem, SeparableGDS, acceleration, batched, certificate, compose, pullback
from jaxrmp._pytree import pytree, static
from jaxrmp._task_map import Distance
from jaxrmp.leaves import Damping, JointLimit, Learned, NominalPotential

pytestmark = pytest.mark.usefixtures("x64")
STATES = 200


@pytree
class Collision(SeparableGDS):
    """RMPflow's collision leaf: `G = w u`, `w = x^-4`, `u = eps + min(0, xd) xd`, `Phi = alpha w^2 / 2`."""

    eps: float = 0.2
    alpha: float = 1e-5
    eta: float = 0.0
    name: str = static(default="collision")

    def metric(self, x, xd):
        return x**-4.0 * (self.eps + jnp.minimum(0, xd) * xd)

    def potential(self, x):
        return 0.5 * self.alpha * x**-8.0

    def damping(self, x, xd):
        return self.eta * self.metric(x, xd)


def collision_as_gds(eps, alpha, eta):
    def metric(x, xd):
        return (x**-4.0 * (eps + jnp.minimum(0, xd) * xd))[None]

    def potential(x):
        return 0.5 * alpha * jnp.sum(x**-8.0)

    return GeometricDynamicalSystem.of(
        Partial(metric), Partial(potential), Partial(lambda x, xd: eta * metric(x, xd)), "collision"
    )


@pytest.mark.parametrize("eta", [0.0, 0.5])
@pytest.mark.parametrize(("eps", "published"), [(0.2, 7.580), (1e-3, 6.751)])
def test_the_collision_leaf_has_the_published_metric_with_one_half_of_the_curvature(eps, published, eta):
    """The check value 7.580 of RMPflow's leaf at x = 0.7, xd = -0.9; a missing 1/2 gives 10.954."""
    x, xd, alpha = 0.7, -0.9, 1e-2
    w, dw, u, du = x**-4, -4 * x**-5, eps + xd * xd, 2 * xd
    M = w * u + 0.5 * xd * w * du
    f = -alpha * w * dw - eta * w * u * xd - 0.5 * xd**2 * u * dw
    np.testing.assert_allclose(M, published, atol=5e-4)
    for leaf in (Collision(eps, alpha, eta), collision_as_gds(eps, alpha, eta)):
        form = leaf(jnp.asarray([x]), jnp.asarray([xd]))
        np.testing.assert_allclose(form.M, [[M]], rtol=1e-13)
        np.testing.assert_allclose(form.f, [f], rtol=1e-12)
        np.testing.assert_allclose(
            leaf.energy(jnp.asarray([x]), jnp.asarray([xd])), 0.5 * w * u * xd**2 + alpha * w**2 / 2
        )
        np.testing.assert_allclose(leaf.dissipation(jnp.asarray([x]), jnp.asarray([xd])), eta * w * u * xd**2)


def test_leaving_an_obstacle_adds_no_curvature_mass():
    form = Collision()(jnp.asarray([0.7]), jnp.asarray([0.9]))
    np.testing.assert_allclose(form.M, [[0.7**-4 * 0.2]], rtol=1e-13)


def test_a_separable_system_is_the_sum_of_its_coordinates():
    x, xd = jnp.asarray([0.5, 0.7, 1.3]), jnp.asarray([0.4, -0.9, 0.0])
    leaf = Collision(alpha=1e-2, eta=0.3)
    form = leaf(x, xd)
    assert form.M.shape == (3, 3)
    np.testing.assert_array_equal(form.M, np.diag(np.diag(form.M)))
    singles = [leaf(x[i : i + 1], xd[i : i + 1]) for i in range(3)]
    np.testing.assert_allclose(form.f, [s.f[0] for s in singles], rtol=1e-13)
    np.testing.assert_allclose(np.diag(form.M), [s.M[0, 0] for s in singles], rtol=1e-13)


@pytest.mark.parametrize("m", [1, 3])
def test_curvature_force_is_the_christoffel_formula(random_gds, m):
    """Equation 2 of the paper, `xi_i = sum_jk 1/2 (d_k M_ij + d_j M_ki - d_i M_jk) xd_j xd_k`, by loops."""
    leaf = random_gds(m, m)
    rng = np.random.default_rng(0)
    x, xd, h = rng.normal(size=m), rng.normal(size=m), 1e-5
    metric = jax.jit(leaf.metric)
    dM = np.stack([(metric(x + h * e, xd) - metric(x - h * e, xd)) / (2 * h) for e in np.eye(m)], axis=-1)
    xi = np.zeros(m)
    for i in range(m):
        for j in range(m):
            for k in range(m):
                xi[i] += 0.5 * (dM[i, j, k] + dM[k, i, j] - dM[j, k, i]) * xd[j] * xd[k]
    potential = jax.jit(leaf.potential)
    slope = np.asarray([(potential(x + h * e) - potential(x - h * e)) / (2 * h) for e in np.eye(m)])
    form = jax.jit(leaf)(x, xd)
    np.testing.assert_allclose(form.f, -slope - leaf.damping(x, xd) @ xd - xi, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(form.M, metric(x, xd), rtol=1e-13)


def test_curvature_metric_of_a_velocity_dependent_system_is_half_the_sum_over_columns(random_gds):
    leaf, m, h = random_gds(4, 3, 0.8), 3, 1e-5
    rng = np.random.default_rng(1)
    x, xd = rng.normal(size=m), rng.normal(size=m)
    metric = jax.jit(leaf.metric)
    dG = np.stack([(metric(x, xd + h * e) - metric(x, xd - h * e)) / (2 * h) for e in np.eye(m)], axis=-1)
    Xi = 0.5 * sum(xd[i] * dG[:, i, :] for i in range(m))
    assert np.abs(Xi - Xi.T).max() > 1e-3  # so a transposed Xi would not pass
    np.testing.assert_allclose(leaf(jnp.asarray(x), jnp.asarray(xd)).M, metric(x, xd) + Xi, rtol=1e-8, atol=1e-8)


def wavy_factor(x):
    m = x.shape[0]
    return jnp.eye(m) + 0.4 * jnp.tril(jnp.sin(3 * x[:, None] + x[None, :] + jnp.arange(m)))


def learned_leaf(seed=0, T=30):
    t = np.linspace(1, 0, T)
    rng = np.random.default_rng(seed)
    points = np.stack([0.5 * t, 0.2 * np.sin(2 * t), 0.1 * t**2], axis=1) + 0.01 * rng.normal(size=(T, 3)) * t[:, None]
    biases = np.sort(rng.uniform(0, 1, T))[::-1].copy()
    potential = NominalPotential(
        jnp.asarray(points), jnp.asarray(biases), jnp.asarray([0.1, 0.0, -0.1]), jnp.asarray(0.05), jnp.asarray(30.0)
    )
    return Learned(potential, Partial(wavy_factor))


@jax.jit
def residuals(tree, x, xd):
    return jax.vmap(lambda x, xd: certificate(tree, x, xd))(x, xd)


residuals_by_lu = jax.jit(lambda tree, x, xd: jax.vmap(lambda x, xd: certificate(tree, x, xd, "lu"))(x, xd))


def assert_certified(tree, n, scale=0.9, run=residuals):
    rng = np.random.default_rng(3)
    x, xd = rng.uniform(-scale, scale, (STATES, n)), rng.normal(size=(STATES, n))
    law = run(tree, x, xd)
    assert law.energy.dtype == np.float64
    # Rounding times the metric's condition number; the bar of the project is 1e-8.
    assert np.max(law.residual) <= 1e-8
    assert (np.asarray(law.dissipation) >= 0).all()
    assert np.abs(law.dV_dt).max() > 1e-6  # the law is not 0 = 0
    np.testing.assert_allclose(law.residual, np.abs(law.dV_dt + law.dissipation) / (1 + np.abs(law.energy)))


LIMIT = dict(weight=0.5, sigma=0.3, stiffness=2.0, damping_rate=0.7)


@pytest.mark.parametrize(
    ("make", "n"),
    [
        (lambda: Damping(0.2, 1.5), 3),
        (lambda: JointLimit(-jnp.ones(3), jnp.ones(3), **LIMIT), 3),
        (learned_leaf, 3),
        (lambda: pullback(Partial(lambda x: x + 2.0), Collision(alpha=0.1, eta=0.4)), 3),
    ],
    ids=["damping", "joint limit", "learned", "collision"],
)
def test_every_leaf_keeps_its_certificate(make, n):
    assert_certified(make(), n)


def test_a_velocity_dependent_system_of_two_dimensions_keeps_its_certificate_resolved_by_lu(random_gds):
    assert_certified(random_gds(1, 2, 0.5), 2, run=residuals_by_lu)


def test_trees_keep_the_certificate(random_map, random_gds):
    def tree(seed):
        maps = [random_map(seed + k, 5, 3) for k in (0, 1)]
        points = Partial(lambda maps, x: jnp.stack([psi(x) for psi in maps]), maps)
        task = compose(random_map(seed + 2, 5, 3), Distance(3 * jnp.ones(3), 0.1))
        return (
            pullback(points, batched(random_gds(seed + 3, 3), random_gds(seed + 4, 3)))
            + pullback(task, Collision(alpha=0.1, eta=0.4))
            + pullback(random_map(seed + 5, 5, 3), learned_leaf(seed))
            + JointLimit(-jnp.ones(5), jnp.ones(5), **LIMIT)
            + Damping(0.05, 1.0)
        )

    for seed in (0, 100, 200):
        assert_certified(tree(seed), 5)


def test_a_velocity_dependent_tree_of_several_dimensions_keeps_the_certificate_by_lu(random_map, random_gds):
    tree = pullback(random_map(0, 4, 3), random_gds(1, 3, 0.5)) + Damping(0.1, 1.0)
    assert_certified(tree, 4, run=residuals_by_lu)


def test_without_curvature_terms_there_is_no_certificate(random_gds):
    """The certificate is measured, not assumed: it must notice a leaf that forgets its Christoffel force."""

    class Forgetful(type(random_gds(0, 3))):
        def __call__(self, x, xd):
            form = super().__call__(x, xd)
            flat = -jax.grad(self.potential)(x) - self.damping(x, xd) @ xd
            return type(form)(flat, form.M)

    leaf = random_gds(0, 3)
    forgetful = Forgetful(leaf.metric_of, leaf.potential_of, leaf.damping_of)
    x, xd = jnp.asarray([0.1, 0.5, -0.3]), jnp.asarray([1.0, -0.5, 0.8])
    assert certificate(leaf, x, xd).residual < 1e-12
    assert certificate(forgetful, x, xd).residual > 1e-2
    assert acceleration(forgetful, x, xd).shape == (3,)
