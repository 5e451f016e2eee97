"""Joint damping and joint limits, against the published formulas written out in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

import jaxrmp
from jaxrmp import GeometricDynamicalSystem, Pointwise, RobotError, acceleration, pullback
from jaxrmp.leaves import Damping, JointLimit
from jaxrmp.simulation import rollout

LOWER, UPPER = np.array([-1.0, -2.0, 0.5]), np.array([1.0, 3.0, 0.9])


@pytest.fixture
def x64():
    with jax.enable_x64(True):
        yield


def published_metric(q, qd, weight, sigma):
    s = (q - LOWER) / (UPPER - LOWER)
    d = 4 * s * (1 - s)
    a_u = 1 - np.exp(-(np.maximum(qd, 0) ** 2) / (2 * sigma**2))
    a_l = 1 - np.exp(-(np.minimum(qd, 0) ** 2) / (2 * sigma**2))
    return weight / (s * (a_u * d + 1 - a_u) + (1 - s) * (a_l * d + 1 - a_l)) ** 2


@pytest.mark.usefixtures("x64")
def test_joint_limit_is_the_published_leaf():
    weight, sigma, stiffness, rate, h = 0.3, 0.7, 2.0, 0.4, 1e-6
    leaf = JointLimit(jnp.asarray(LOWER), jnp.asarray(UPPER), None, weight, sigma, stiffness, rate, barrier=0.0)
    np.testing.assert_allclose(leaf.rest, (LOWER + UPPER) / 2)
    run = jax.jit(lambda q, qd: (leaf(q, qd), leaf.energy(q, qd), leaf.dissipation(q, qd)))
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, qd = rng.uniform(LOWER, UPPER), rng.normal(size=3)
        G = published_metric(q, qd, weight, sigma)
        dG_dqd = (published_metric(q, qd + h, weight, sigma) - published_metric(q, qd - h, weight, sigma)) / (2 * h)
        dG_dq = (published_metric(q + h, qd, weight, sigma) - published_metric(q - h, qd, weight, sigma)) / (2 * h)
        pull = weight * stiffness * ((LOWER + UPPER) / 2 - q)
        form, energy, dissipation = run(q, qd)
        size = (
            G.max() * (1 + np.abs(qd).max()) ** 2 / 0.4
        )  # of the terms whose differences carry the error h^2 + eps / h
        np.testing.assert_allclose(form.M, np.diag(G + 0.5 * qd * dG_dqd), rtol=1e-6, atol=1e-7 * size)
        np.testing.assert_allclose(form.f, pull - rate * G * qd - 0.5 * qd**2 * dG_dq, rtol=1e-6, atol=1e-7 * size)
        spring = 0.5 * weight * stiffness * (q - (LOWER + UPPER) / 2) ** 2
        np.testing.assert_allclose(energy, np.sum(0.5 * G * qd**2 + spring), rtol=1e-12)
        np.testing.assert_allclose(dissipation, np.sum(rate * G * qd**2), rtol=1e-12)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("side", [1, -1])
def test_the_metric_grows_towards_a_limit_with_speed_and_only_towards_it(side):
    leaf = JointLimit(jnp.asarray([-1.0]), jnp.asarray([1.0]), weight=1.0, sigma=0.5, barrier=0.0)
    approach = side * jnp.linspace(0.0, 0.99, 30)[:, None]
    metric = jax.jit(jax.vmap(leaf.metric))
    towards = np.asarray(metric(approach, jnp.full_like(approach, side * 1.0))).ravel()
    assert (np.diff(towards) > 0).all() and towards[-1] > 20
    away = np.asarray(metric(approach[-1:], -jnp.full((1, 1), side * 1.0))).ravel()
    assert away < 1.05  # d acts with the share 1 - s, which is small here
    np.testing.assert_allclose(metric(approach, 0 * approach), 1.0, rtol=1e-12)  # at rest it is flat
    speeds = side * jnp.linspace(0.0, 1.5, 30)[:, None]
    faster = np.asarray(metric(jnp.full_like(speeds, side * 0.95), speeds)).ravel()
    assert (np.diff(faster) > 0).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.usefixtures("x64")
def test_gradients_are_finite_at_the_limits_and_at_rest(dtype):
    leaf = JointLimit(jnp.asarray(LOWER, dtype), jnp.asarray(UPPER, dtype))

    @jax.jit
    def slopes(q, qd, sigma):
        def loss(q, qd, sigma):
            leaf_ = JointLimit(leaf.lower, leaf.upper, sigma=sigma)
            form = leaf_(q, qd)
            return jnp.sum(form.f) + jnp.sum(form.M) + leaf_.energy(q, qd)

        return jax.value_and_grad(loss, argnums=(0, 1, 2))(q, qd, sigma)

    for q in (LOWER, UPPER, (LOWER + UPPER) / 2):
        for speed in (0.0, 0.1, -0.1, 0.3):
            value, gradient = slopes(q.astype(dtype), np.full(3, speed, dtype), np.asarray(0.1, dtype))
            assert value.dtype == dtype
            assert np.isfinite(value) and all(np.isfinite(g).all() for g in gradient), (q, speed)


@pytest.mark.parametrize(
    ("lower", "upper", "joints"),
    [
        ([0.0, -np.inf], [1.0, np.inf], r"joints \[1\]"),
        ([1.0, 0.0], [1.0, 1.0], r"joints \[0\]"),
        ([2.0, np.nan], [1.0, 1.0], r"joints \[0, 1\]"),
    ],
    ids=["infinite", "empty", "reversed and nan"],
)
def test_ranges_that_are_no_ranges_are_refused_with_the_joints_at_fault(lower, upper, joints):
    with pytest.raises(RobotError, match=joints + r" have lower .*Selection"):
        JointLimit(jnp.asarray(lower), jnp.asarray(upper))


def test_limits_can_be_built_inside_a_compiled_function():
    lower, upper = jnp.asarray(LOWER, jnp.float32), jnp.asarray(UPPER, jnp.float32)
    q, qd = (lower + upper) / 2 + 0.1, jnp.ones(3)
    inside = jax.jit(lambda q, qd: JointLimit(lower, upper)(q, qd).f)(q, qd)
    np.testing.assert_allclose(inside, JointLimit(lower, upper)(q, qd).f, rtol=1e-5)
    moved = jax.jit(lambda lower: JointLimit(lower, upper)(q, qd).f)(lower)
    np.testing.assert_allclose(inside, moved, rtol=1e-5)


def spring(goal, rate):
    """A pull of 25 /s^2 towards `goal` with unit mass."""
    return GeometricDynamicalSystem.of(
        Partial(lambda x, xd: jnp.eye(1)),
        Partial(lambda goal, x: 12.5 * jnp.sum((x - goal) ** 2), jnp.asarray(goal)),
        Partial(lambda rate, x, xd: rate * jnp.eye(1), jnp.asarray(rate)),
    )


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(("goal", "rate"), [(0.95, 2.0), (2.0, 10.0), (5.0, 2.0)])
def test_a_strong_pull_towards_and_past_a_limit_does_not_cross_it(goal, rate):
    pull = spring(goal, rate)
    limit = JointLimit(jnp.asarray([-1.0]), jnp.asarray([1.0]))
    without_barrier = JointLimit(jnp.asarray([-1.0]), jnp.asarray([1.0]), barrier=0.0)
    free, held, metric_only = (ROLL(tree) for tree in (pull, pull + limit, pull + without_barrier))
    assert free.q.max() > 1.4 and metric_only.q.max() > 1.1
    assert held.q.max() < 1.0
    assert held.q[-1] > 0.5  # and it is the limit that holds it, not a fear of motion


ROLL = jax.jit(lambda tree: rollout(tree, jnp.zeros(1), duration=4.0))


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("side", [1, -1])
def test_the_barrier_is_its_formula_and_pushes_a_state_outside_back_in(side):
    barrier, reach = 0.02, 0.2
    walls = JointLimit(jnp.asarray([-1.0]), jnp.asarray([1.0]), stiffness=0.0, barrier=barrier, reach=reach)
    value = jax.jit(lambda q: walls.potential(q)[0])
    push = jax.jit(lambda q: walls(q, jnp.zeros(1)).f[0])
    for x in (0.9, 0.3, 0.1, 0.01, 0.0041):
        w = max(reach - x, 0) / x
        np.testing.assert_allclose(value(jnp.asarray([side * (1 - x)])), barrier * 0.5 * w * w, rtol=1e-9)
    slope = barrier * 49 * 50 / 0.004  # w reach / x^2 at x = reach / 50, where the straight line begins
    for x in (0.003, 0.0, -0.01, -1.0):
        np.testing.assert_allclose(push(jnp.asarray([side * (1 - x)])), -side * slope, rtol=1e-9)
        expected = barrier * 0.5 * 49**2 + slope * (0.004 - x)
        np.testing.assert_allclose(value(jnp.asarray([side * (1 - x)])), expected, rtol=1e-9)
    assert push(jnp.asarray([0.3])) == 0


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0])
def test_a_coasting_joint_is_slowed_down_as_its_energy_says(speed):
    """Undamped, `G(q, qd) qd^2` is kept: at the limit `exp(v^2 / sigma^2) v^2 = v0^2`, a few sigma at most."""
    sigma = 0.1
    limit = JointLimit(
        jnp.asarray([-1.0]), jnp.asarray([1.0]), sigma=sigma, stiffness=0.0, damping_rate=0.0, barrier=0.0
    )
    path = jax.jit(lambda v: rollout(limit, jnp.zeros(1), v, duration=8.0, dt=0.002))(jnp.asarray([speed]))
    q, qd = np.asarray(path.q[:, 0]), np.asarray(path.qd[:, 0])
    v = np.linspace(0, 1, 100001)
    expected = np.interp(speed**2, np.exp((v / sigma) ** 2) * v**2, v)
    assert q.max() > 1  # the metric slows down but does not push back: hence the barrier
    assert expected < 3 * sigma
    np.testing.assert_allclose(np.interp(1.0, q, qd), expected, rtol=0.02)


@pytest.mark.usefixtures("x64")
def test_joint_damping_alone_is_exponential_decay():
    qd = jnp.asarray([1.0, -2.0])
    damping = Damping(jnp.asarray([0.1, 5.0]), jnp.asarray([2.0, 3.0]))
    np.testing.assert_allclose(acceleration(damping, jnp.zeros(2), qd), [-2.0, 6.0], rtol=1e-12)
    np.testing.assert_allclose(damping(qd, qd).M, np.diag([0.1, 5.0]), rtol=1e-12)
    np.testing.assert_allclose(damping.dissipation(qd, qd), 0.1 * 2 + 5 * 3 * 4, rtol=1e-12)
    np.testing.assert_allclose(damping.energy(qd, qd), 0.5 * (0.1 + 5 * 4), rtol=1e-12)


@pytest.fixture
def strict():
    with jax.numpy_dtype_promotion("strict"):
        yield


@pytest.mark.usefixtures("strict")
def test_joint_leaves_mix_no_dtypes():
    q = jnp.asarray([0.2, -0.4], jnp.float32)
    tree = JointLimit(-jnp.ones(2), jnp.ones(2)) + Damping()
    qdd = jax.jit(acceleration)(tree, q, q)
    assert qdd.dtype == jnp.float32
    assert np.isfinite(qdd).all()
    assert pullback(Pointwise(lambda x: 2.0 * x), Damping()).energy(q[:, None], q[:, None]).dtype == jnp.float32


@pytest.mark.usefixtures("x64")
def test_single_precision_states_stay_single_whatever_the_parameters_are():
    q = jnp.asarray([0.2, -0.4, 0.6], jnp.float32)
    gain = jnp.asarray(0.5, jnp.float64)
    limit = JointLimit(
        jnp.asarray(LOWER), jnp.asarray(UPPER), weight=gain, sigma=gain, stiffness=gain, damping_rate=gain
    )
    for leaf in (limit, Damping(gain, gain)):
        form = leaf(q, q)
        assert form.f.dtype == form.M.dtype == leaf.energy(q, q).dtype == leaf.dissipation(q, q).dtype == jnp.float32


@pytest.mark.parametrize(("name", "value"), [("weight", 0.0), ("sigma", -0.1), ("reach", 0.0), ("barrier", -1.0)])
def test_joint_limit_gains_out_of_range_are_named(name, value):
    with pytest.raises(jaxrmp.ConfigurationError, match=f"{name} of JointLimit is {value}, expected"):
        JointLimit(-np.ones(2), np.ones(2), **{name: value})


@jax.jit
def pushed(leaf, start, push):
    """A second of a joint without inertia of its own, under a constant force."""
    force = GeometricDynamicalSystem.of(
        Partial(lambda x, xd: jnp.zeros((1, 1))),
        Partial(lambda push, x: -push * jnp.sum(x), push),
        Partial(lambda x, xd: 0.02 * jnp.eye(1)),
    )
    return rollout(force + leaf, start, duration=1.0, dt=0.001)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(("margin", "push"), [(0.001, 0.0), (0.02, 15.0), (0.01, 30.0)])
def test_a_joint_of_little_inertia_meets_its_barrier_in_steps_of_a_millisecond(margin, push):
    """Pushed hard, or started at its limit, it comes to rest there, and the energy never rises."""
    leaf = JointLimit(jnp.asarray([-1.0]), jnp.asarray([1.0]))
    path = pushed(leaf, jnp.asarray([1.0 - margin]), push)
    rises = np.diff(np.asarray(path.energy))
    assert np.abs(path.qd).max() < 10 and (np.asarray(path.q) < 1).all()
    assert rises.max() < 1e-4 * np.ptp(path.energy)
    if push:
        assert abs(float(path.qd[-1, 0])) < 1e-3


@pytest.mark.parametrize("name", ["weight", "damping_rate"])
def test_damping_that_would_drive_is_refused(name):
    with pytest.raises(
        jaxrmp.ConfigurationError, match=f"{name} of Damping is -1.0, expected a number that is not neg"
    ):
        Damping(**{name: -1.0})
