"""The nominal potential and the learned leaf, against the paper's formulas written out in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import ConfigurationError, GeometricDynamicalSystem, acceleration
from jaxrmp.leaves import Damping, Learned, NominalPotential, natural_gradient_field
from jaxrmp.leaves._nominal_potential import _by_definition, log_cosh_of_square

T = 25


@pytest.fixture
def x64():
    with jax.enable_x64(True):
        yield


@pytest.fixture
def strict():
    with jax.numpy_dtype_promotion("strict"):
        yield


def parameters():
    rng = np.random.default_rng(0)
    t = np.linspace(1, 0, T)[:, None]
    points = t * [0.5, -0.2, 0.3] + 0.05 * np.sin(6 * t) * [0.0, 1.0, 1.0]
    return points, np.sort(rng.uniform(0, 0.6, T))[::-1].copy(), np.array([0.2, -0.1, 0.05]), 0.06, 30.0


def potential(dtype=np.float64):
    return NominalPotential(*(jnp.asarray(a, dtype) for a in parameters()))


def potential_by_definition(x):
    """Equations 4 to 6, kernel by kernel; fine near the trajectory, where no kernel sum underflows."""
    points, biases, end_slope, width, eta = parameters()
    weights, terms = [], []
    for z, bias in zip(points, biases, strict=True):
        r = np.linalg.norm(x - z)
        weights.append(np.exp(-(r**2) / (2 * width**2)))
        terms.append(np.log(np.exp(eta * r) + np.exp(-eta * r)) / eta + bias)
    correction = end_slope @ (x - points[-1]) * np.exp(-np.sum((x - points[-1]) ** 2) / (2 * width**2))
    return np.dot(weights, terms) / np.sum(weights) - correction


@pytest.mark.usefixtures("x64")
def test_the_potential_and_its_slope_agree_with_the_definition():
    points = parameters()[0]
    value_and_slope = jax.jit(jax.value_and_grad(potential()))
    rng = np.random.default_rng(1)
    for x in [*(points[::6] + rng.normal(scale=0.05, size=points[::6].shape)), points[3], points[-1]]:
        value, slope = value_and_slope(x)
        np.testing.assert_allclose(value, potential_by_definition(x), rtol=1e-12)
        h = 1e-6
        numeric = [
            (potential_by_definition(x + h * e) - potential_by_definition(x - h * e)) / (2 * h) for e in np.eye(3)
        ]
        np.testing.assert_allclose(slope, numeric, rtol=1e-6, atol=1e-7)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_value_slope_and_hessian_are_finite_on_the_points_at_the_goal_and_far_away(dtype):
    phi = potential(dtype)
    points = parameters()[0]
    x = np.concatenate([points, 1e-9 * np.ones((1, 3)), 1e3 * np.eye(3), -1e3 * np.ones((1, 3))]).astype(dtype)
    value, slope, hessian = jax.jit(jax.vmap(lambda x: (phi(x), jax.grad(phi)(x), jax.hessian(phi)(x))))(x)
    assert value.dtype == slope.dtype == dtype
    for a in (value, slope, hessian):
        assert np.isfinite(a).all()
    # Far away the pull has unit slope, up to rounding of distance^2 / width^2 in the kernels: hence 10 m in float32.
    far = (1e3 if dtype == np.float64 else 10.0) * np.eye(3, dtype=dtype)
    norms = np.linalg.norm(np.asarray(jax.jit(jax.vmap(jax.grad(phi)))(far), float), axis=-1)
    np.testing.assert_allclose(norms, 1, atol=2e-2)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(("dtype", "rtol"), [(np.float32, 2e-4), (np.float64, 1e-8)])
def test_the_valley_floor_is_smooth_at_every_distance(dtype, rtol):
    """Slope tanh(eta r) and curvatures eta sech^2 (along) and eta tanh(eta r) / (eta r) (across) from 0 to 0.1 m."""
    eta = 30.0
    r = np.concatenate([[0.0], np.logspace(-22, -1, 64)]).astype(dtype)
    x = np.stack([r, np.zeros_like(r)], axis=1)

    def phi(x):
        return log_cosh_of_square(jnp.sum(x * x), jnp.asarray(eta, dtype))

    value, slope, hessian = jax.jit(jax.vmap(lambda x: (phi(x), jax.grad(phi)(x), jax.hessian(phi)(x))))(x)
    z = eta * r.astype(float)
    np.testing.assert_allclose(value, np.logaddexp(z, -z) / eta, rtol=5e-7 if dtype == np.float32 else 1e-13)
    np.testing.assert_allclose(slope[:, 0], np.tanh(z), rtol=rtol, atol=1e-30)
    across = np.where(z > 0, np.tanh(z) / np.where(z > 0, z, 1), 1)
    np.testing.assert_allclose(hessian[:, 0, 0], eta / np.cosh(z) ** 2, rtol=10 * rtol, atol=eta * rtol)
    np.testing.assert_allclose(hessian[:, 1, 1], eta * across, rtol=rtol)


def wavy_factor(x):
    return jnp.eye(3, dtype=x.dtype) + 0.5 * jnp.tril(jnp.sin(4.0 * x[:, None] + x[None, :]))


@pytest.mark.usefixtures("x64")
def test_the_slope_written_out_is_that_of_the_definition_in_the_state_and_in_every_parameter():
    arguments = tuple(jnp.asarray(p, float) for p in parameters())
    every = tuple(range(1 + len(arguments)))
    x = jnp.asarray(np.random.default_rng(4).uniform(-0.4, 0.4, (5, 3)))
    ours, definition = (
        jax.jit(jax.vmap(jax.grad(phi, argnums=every), in_axes=(0, *[None] * len(arguments))))(x, *arguments)
        for phi in (lambda x, *p: NominalPotential(*p)(x), _by_definition)
    )
    for a, e in zip(ours, definition, strict=True):
        np.testing.assert_allclose(a, e, rtol=0, atol=1e-10 * np.abs(e).max())


@pytest.mark.usefixtures("x64")
def test_the_learned_leaf_is_the_geometric_dynamical_system_of_its_metric_and_potential():
    leaf = Learned(potential(), Partial(wavy_factor), speed=0.3, damping_rate=7.0)
    x, xd = (jnp.asarray(a) for a in np.random.default_rng(5).uniform(-0.5, 0.5, (2, 6, 3)))
    ours = jax.jit(jax.vmap(leaf))(x, xd)
    by_autodiff = jax.jit(jax.vmap(lambda x, xd: GeometricDynamicalSystem.__call__(leaf, x, xd)))(x, xd)
    np.testing.assert_allclose(ours.f, by_autodiff.f, rtol=0, atol=1e-10 * np.abs(by_autodiff.f).max())
    np.testing.assert_allclose(ours.M, by_autodiff.M, rtol=1e-12)


@pytest.mark.usefixtures("x64")
def test_the_learned_field_is_the_natural_gradient():
    leaf = Learned(potential(), Partial(wavy_factor), speed=0.3, damping_rate=7.0)

    @jax.jit
    def parts(x):
        return leaf.field(x), leaf.cholesky_of(x), jax.grad(leaf.potential_of)(x), leaf.potential(x)

    reference = jax.jit(potential())
    for x in np.random.default_rng(2).uniform(-0.5, 0.5, (5, 3)):
        field, L, slope, scaled = (np.asarray(a) for a in parts(x))
        np.testing.assert_allclose(field, -np.linalg.solve(L @ L.T, slope), rtol=1e-10)
        np.testing.assert_allclose(scaled, 0.3 * 7.0 * reference(x), rtol=1e-12)


@pytest.mark.usefixtures("x64")
def test_the_learned_leaf_cruises_at_its_speed_times_the_field():
    """Where `qd = speed field` the policy neither speeds up nor slows down, up to the curvature force alone."""
    leaf = Learned(potential(), Partial(lambda x: jnp.diag(jnp.asarray([1.0, 2.0, 0.5]))), speed=0.3, damping_rate=7.0)
    x = jnp.asarray([0.4, -0.1, 0.2])
    steady = 0.3 * jax.jit(leaf.field)(x)
    run = jax.jit(acceleration)
    np.testing.assert_allclose(run(leaf, x, steady), 0, atol=1e-12)  # a constant metric has no curvature
    np.testing.assert_allclose(run(leaf, x, steady + 0.1), -7.0 * 0.1 * np.ones(3), rtol=1e-10)
    np.testing.assert_allclose(
        jax.jit(leaf.dissipation)(x, steady), 7.0 * steady @ np.diag([1, 4, 0.25]) @ steady, rtol=1e-12
    )


def test_the_natural_gradient_of_a_batch():
    rng = np.random.default_rng(3)
    L = np.tril(rng.normal(size=(4, 3, 3)), -1) + 2 * np.eye(3)
    slope = rng.normal(size=(4, 3))
    expected = -np.linalg.solve(L @ np.swapaxes(L, -1, -2), slope[..., None])[..., 0]
    np.testing.assert_allclose(
        natural_gradient_field(jnp.asarray(L), jnp.asarray(slope)), expected, rtol=1e-4, atol=1e-5
    )


@pytest.mark.usefixtures("strict")
def test_the_learned_leaf_mixes_no_dtypes():
    x = jnp.asarray([0.2, -0.4, 0.1], jnp.float32)
    tree = Learned(potential(np.float32), Partial(wavy_factor)) + Damping()
    qdd = jax.jit(acceleration)(tree, x, x)
    assert qdd.dtype == jnp.float32
    assert np.isfinite(qdd).all()


@pytest.mark.usefixtures("x64")
def test_single_precision_states_stay_single_whatever_the_gains_are():
    x = jnp.asarray([0.2, -0.4, 0.1], jnp.float32)
    gain = jnp.asarray(0.5, jnp.float64)
    leaf = Learned(potential(), Partial(wavy_factor), speed=gain, damping_rate=gain)
    form, energy, dissipation = jax.jit(lambda x: (leaf(x, x), leaf.energy(x, x), leaf.dissipation(x, x)))(x)
    assert form.f.dtype == form.M.dtype == energy.dtype == dissipation.dtype == jnp.float32


@pytest.mark.parametrize("name", ["speed", "damping_rate"])
def test_a_negative_gain_is_refused(name):
    with pytest.raises(ConfigurationError, match=f"{name} of Learned is -2.0, expected a number that is not negative"):
        Learned(potential(np.float32), Partial(wavy_factor), **{name: -2.0})
