"""Collision avoidance: both published forms, RMPflow's check value, and what happens at contact and inside."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, Distance, UnknownNameError, pullback
from jaxrmp.leaves import Attractor, CollisionAvoidance, Damping
from jaxrmp.simulation import rollout

pytestmark = pytest.mark.usefixtures("x64")

COMPACT = dict(epsilon=0.1, barrier=0.03, damping_rate=0.8, reach=0.2, sigma=0.4, frequency=np.inf)
POWER = dict(epsilon=0.1, barrier=0.003, damping_rate=0.8, floor=0.3, frequency=np.inf, form="power")
PUBLISHED = dict(epsilon=0.2, barrier=1e-5, damping_rate=0.0, sigma=0.5, frequency=np.inf)


def at(*values):
    return jnp.asarray(values, float)


@pytest.mark.parametrize(("epsilon", "mass"), [(0.2, 7.580), (1e-3, 6.751)])
def test_check_value(epsilon, mass):
    """At x = 0.7, xd = -0.9; without the 1/2 of the curvature mass it would be 10.954 for epsilon = 0.2."""
    leaf = CollisionAvoidance(**(PUBLISHED | dict(epsilon=epsilon)), form="power")
    M = leaf(at(0.7), at(-0.9)).M[0, 0]
    assert abs(M - mass) < 5e-4
    np.testing.assert_allclose(M, 0.7**-4 * (epsilon + 2 * 0.9**2), rtol=1e-14)


def test_the_power_form_is_its_formula():
    leaf = CollisionAvoidance(**POWER)
    for x, xd in ((0.5, -0.7), (0.31, -2.0), (1.4, 0.8), (0.9, 0.0)):
        w, slope, v = x**-4, -4 * x**-5, min(xd, 0)
        u = 0.1 + v * xd
        form = leaf(at(x), at(xd))
        np.testing.assert_allclose(form.M[0, 0], w * u + 0.5 * xd * w * 2 * v, rtol=1e-13)
        force = -0.003 * w * slope - 0.5 * xd**2 * u * slope - 0.8 * w * u * xd
        np.testing.assert_allclose(form.f[0], force, rtol=1e-12)
        np.testing.assert_allclose(leaf.energy(at(x), at(xd)), 0.5 * w * u * xd**2 + 0.5 * 0.003 * w * w, rtol=1e-13)


def test_the_compact_form_is_its_formula_and_is_not_felt_beyond_reach():
    leaf = CollisionAvoidance(**COMPACT)
    for x, xd in ((0.15, -0.7), (0.01, -2.0), (0.1, 0.8), (0.19, 0.0)):
        w, slope, v = (0.2 - x) / x, -0.2 / x**2, min(xd, 0)
        bell = np.exp(-(v**2) / (2 * 0.4**2))
        u, du = 0.1 + 1 - bell, v / 0.4**2 * bell
        form = leaf(at(x), at(xd))
        np.testing.assert_allclose(form.M[0, 0], w * u + 0.5 * xd * w * du, rtol=1e-13)
        force = -0.03 * w * slope - 0.5 * xd**2 * u * slope - 0.8 * w * u * xd
        np.testing.assert_allclose(form.f[0], force, rtol=1e-12)
    for x in (0.2000001, 1.0, 1e3):
        form = leaf(at(x), at(-1.0))
        assert form.M[0, 0] == 0 and form.f[0] == 0 and leaf.energy(at(x), at(-1.0)) == 0


@pytest.mark.parametrize("leaf", [CollisionAvoidance(**COMPACT), CollisionAvoidance(**POWER)], ids=["compact", "power"])
def test_below_the_floor_it_is_finite_constant_and_outwards(leaf):
    floor = 0.3 if leaf.form == "power" else 0.2 / 50
    w, slope = (floor**-4, -4 * floor**-5) if leaf.form == "power" else (49.0, -0.2 / floor**2)
    for x in (floor, floor / 2, 0.0, -0.05, -3.0):
        form = leaf(at(x), at(0.0))
        np.testing.assert_allclose(form.f[0], -leaf.barrier * w * slope, rtol=1e-12)
        assert form.f[0] > 0
        np.testing.assert_allclose(form.M[0, 0], 0.1 * w, rtol=1e-12)
        height = leaf.barrier * (0.5 * w * w + w * slope * (x - floor))
        np.testing.assert_allclose(leaf.potential(at(x))[0], height, rtol=1e-12)


@pytest.mark.parametrize(
    ("leaf", "low", "high"),
    [
        (CollisionAvoidance(**COMPACT), -0.05, 0.3),
        (CollisionAvoidance(**POWER), -0.2, 2.0),
        (CollisionAvoidance(**(COMPACT | dict(frequency=40.0))), -0.05, 0.3),
    ],
    ids=["compact", "power", "with inertia"],
)
def test_certificate_outside_at_contact_and_inside(leaf, low, high, assert_certified, assert_single):
    rng = np.random.default_rng(0)
    assert_certified(leaf + Damping(0.01), rng.uniform(low, high, (1000, 3)), rng.normal(size=(1000, 3)))
    assert_single(leaf, np.array([0.1, 1e3]), np.ones(2))


@pytest.mark.parametrize("form", ["compact", "power"])
def test_finite_at_contact_at_rest_and_far_away(form, assert_smooth):
    x = np.array([0.0, -1.0, 0.05, 0.0014, 0.07, 1e3])[:, None]
    for speed in (0.0, -1.0, 1.0):
        assert_smooth(CollisionAvoidance(form=form), x, np.full_like(x, speed))


def test_a_pull_into_an_obstacle_does_not_enter_it():
    center, radius = jnp.array([0.0, 0.02, 0.0]), 0.3
    pull = Attractor(jnp.zeros(3), gain=2.0)
    run = jax.jit(lambda tree: rollout(tree, jnp.array([-1.0, 0.0, 0.1]), duration=6.0, dt=1e-3).q)
    distance = lambda q: np.linalg.norm(q - center, axis=1).min() - radius  # noqa: E731
    assert distance(run(pull)) < -0.1
    for gains in ({}, PUBLISHED | dict(barrier=0.5), PUBLISHED | dict(barrier=1e-3, form="power")):
        path = run(pull + pullback(Distance(center, radius), CollisionAvoidance(**gains)))
        assert distance(path) > 0, gains


@jax.jit
def second_of(tree, start):
    return rollout(tree, start, duration=1.0, dt=1e-3)


@pytest.mark.parametrize(("start", "push"), [(0.005, 0.0), (0.03, 30.0)])
def test_little_mass_meets_a_high_barrier_in_steps_of_a_millisecond(start, push):
    """Released inside it, or pushed against it, it comes to rest; without the barrier's own inertia it does not."""
    pull = Attractor(at(-5.0), weight_near=0.02, weight_far=0.02, gain=push / 0.02, damping_rate=0.0)
    rises = {}
    for frequency in (float("inf"), 60.0):
        leaf = CollisionAvoidance(0.01, 0.1, 0.0, 0.1, 0.5, 0.002, frequency)
        path = second_of(pull + leaf, at(start))
        rises[frequency] = np.diff(np.asarray(path.energy)).max() / np.ptp(path.energy)
    assert np.asarray(path.q).min() > 0.002 and np.abs(path.qd).max() < 10
    assert push == 0 or abs(float(path.qd[-1, 0])) < 1e-3
    assert rises[60.0] < 1e-3 < 1e-2 < rises[float("inf")]


def test_no_retrace_and_structure(traces_of):
    assert traces_of(CollisionAvoidance(), jnp.array([0.01])) == 1
    assert traces_of(CollisionAvoidance(floor=0.02), jnp.array([0.01])) == 1


def test_bad_parameters_are_named():
    with pytest.raises(UnknownNameError, match="unknown form of collision avoidance 'powr'. Did you mean 'power'"):
        CollisionAvoidance(form="powr")
    for name, value in (
        ("reach", 0.0),
        ("sigma", -1.0),
        ("floor", 0.0),
        ("barrier", -1e-5),
        ("epsilon", np.nan),
        ("frequency", 0.0),
    ):
        with pytest.raises(ConfigurationError, match=f"{name} of CollisionAvoidance is {value}, expected"):
            CollisionAvoidance(**{name: value})
    with pytest.raises(ConfigurationError, match=r"floor is 0.07 and reach 0.07: expected floor < reach"):
        CollisionAvoidance(floor=0.07, reach=0.07)
