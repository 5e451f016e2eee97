"""Attractors, isotropic and stretched: force, potential, certificate, and what happens at the goal."""

import itertools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from jaxrmp import ConfigurationError, uncertified_leaves
from jaxrmp.leaves import Attractor, StretchedAttractor
from jaxrmp.simulation import rollout

GOAL = np.array([0.3, -0.2, 0.5])
GAINS = dict(weight_near=8.0, weight_far=0.7, width=0.6, sharpness=3.0, gain=1.7, damping_rate=1.1)
STRETCH = dict(stretch_width=0.4, floor=0.05, isotropy=0.02)
LEAVES = {"isotropic": (Attractor, GAINS), "stretched": (StretchedAttractor, GAINS | STRETCH)}


@pytest.fixture(params=LEAVES)
def leaf(request, x64):
    kind, gains = LEAVES[request.param]
    return kind(jnp.asarray(GOAL), **gains)


@pytest.fixture
def states():
    rng = np.random.default_rng(0)
    return GOAL + rng.normal(size=(1000, 3)), rng.normal(size=(1000, 3))


def pull(r, gains):
    """Size of the published pull at distance r, in NumPy."""
    share = np.exp(-(r**2) / (2 * gains["width"] ** 2))
    share = (1 - gains.get("floor", 0)) * share + gains.get("floor", 0)
    w = (gains["weight_near"] - gains["weight_far"]) * share + gains["weight_far"]
    return gains["gain"] * (1 + gains.get("isotropy", 0)) * w * np.tanh(gains["sharpness"] * r)


def published_metric(leaf, x, gains):
    z = np.asarray(x) - GOAL
    r = np.linalg.norm(z)
    if "floor" not in gains:
        share = np.exp(-(r**2) / (2 * gains["width"] ** 2))
        return ((gains["weight_near"] - gains["weight_far"]) * share + gains["weight_far"]) * np.eye(3)
    bump = [
        (1 - gains["floor"]) * np.exp(-(r**2) / (2 * gains[s] ** 2)) + gains["floor"]
        for s in ("width", "stretch_width")
    ]
    w = (gains["weight_near"] - gains["weight_far"]) * bump[0] + gains["weight_far"]
    return w * ((1 - bump[1]) * np.outer(z, z) / r**2 + (bump[1] + gains["isotropy"]) * np.eye(3))


def gains_of(leaf):
    return next(gains for kind, gains in LEAVES.values() if type(leaf) is kind)


def test_force_at_rest_and_metric_are_the_published_ones(leaf, states):
    gains, at_rest = gains_of(leaf), jax.jit(lambda x: leaf(x, jnp.zeros(3)))
    for x in states[0][:50]:
        z, G = x - GOAL, published_metric(leaf, x, gains)
        form = at_rest(x)
        r = np.linalg.norm(z)
        np.testing.assert_allclose(form.M, G, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(form.f, -gains["gain"] * G @ z / r * np.tanh(gains["sharpness"] * r), rtol=1e-11)


def test_the_stretched_pull_is_a_gradient_because_it_points_at_the_goal(states):
    """G grad Phi' has no potential in general; with both along z it does: its Jacobian is symmetric."""
    with jax.enable_x64(True):
        leaf = StretchedAttractor(jnp.asarray(GOAL), **GAINS, **STRETCH)

        def published(x):
            z = x - GOAL
            r = jnp.sqrt(z @ z)
            return leaf.metric(x, x) @ z / r * jnp.tanh(GAINS["sharpness"] * r)

        slopes = jax.jit(jax.vmap(jax.jacfwd(published)))(states[0])
        np.testing.assert_allclose(slopes, np.swapaxes(slopes, 1, 2), atol=1e-11)

        def skewed(x):  # the same metric with a pull elsewhere: no gradient, so the test can tell
            return leaf.metric(x, x) @ (x - GOAL - 0.5)

        slopes = jax.jit(jax.vmap(jax.jacfwd(skewed)))(states[0])
        assert np.abs(slopes - np.swapaxes(slopes, 1, 2)).max() > 0.1
        assert uncertified_leaves(leaf) == ()


@pytest.mark.parametrize("width", [0.03, 1.0, 5.0])
@pytest.mark.parametrize("sharpness", [0.2, 1.0, 20.0, 400.0])
@pytest.mark.parametrize("kind", LEAVES)
@pytest.mark.usefixtures("x64")
def test_the_potential_is_the_integral_of_the_pull(kind, width, sharpness):
    make, gains = LEAVES[kind]
    gains = gains | dict(width=width, sharpness=sharpness)
    leaf = make(jnp.asarray(GOAL), **gains)
    along = np.array([2.0, -1.0, 2.0]) / 3
    radii = np.array([1e-9, 1e-4, 1e-3, 0.02, 0.1, 0.3, 0.7, 1.0, 2.0, 3.3, 5.0])
    potential = ENERGIES(leaf, GOAL + radii[:, None] * along)
    edges = sorted({0.0, *radii, *(k / sharpness for k in (1, 3, 8, 20)), *(k * width for k in (1, 3, 6, 9))})
    pieces = [quad(pull, a, b, (gains,), epsabs=1e-14, epsrel=1e-13)[0] for a, b in itertools.pairwise(edges)]
    expected = np.interp(radii, edges, np.concatenate([[0], np.cumsum(pieces)]))
    np.testing.assert_allclose(potential, expected, rtol=1e-12, atol=1e-13)


ENERGIES = jax.jit(lambda leaf, x: jax.vmap(leaf.potential)(x))


def test_certificate(leaf, states, assert_certified):
    assert_certified(leaf, *states)


def test_smooth_at_the_goal_and_at_rest(leaf, assert_smooth, assert_single):
    offsets = np.array([0, 1e-200, 1e-9, 1e-4, 0.0577, 0.0578, 1.0, 40.0])  # where the series take over among them
    x = GOAL + offsets[:, None] * np.array([1.0, 0.0, 0.0])
    assert_smooth(leaf, x, np.zeros_like(x))
    assert_smooth(leaf, x, np.ones_like(x))
    assert_single(leaf, GOAL, GOAL)


def test_the_goal_is_an_isotropic_spring(leaf):
    gains = gains_of(leaf)
    stiffness = gains["gain"] * gains["sharpness"] * gains["weight_near"] * (1 + gains.get("isotropy", 0))
    hessian = jax.hessian(leaf.potential)
    second, third = jax.jit(lambda x: (hessian(x), jax.jacfwd(hessian)(x)))(GOAL)
    np.testing.assert_allclose(second, stiffness * np.eye(3), rtol=1e-13)
    np.testing.assert_allclose(third, 0, atol=1e-10)


def test_gradients_of_force_and_energy_in_the_gains_are_right(leaf, states):
    x, h = jnp.asarray(states[0][0]), 1e-6
    for of in (lambda leaf: leaf.potential(x), lambda leaf: leaf(x, x).f[1]):
        slopes, value = jax.jit(jax.grad(of))(leaf), jax.jit(of)
        for name in gains_of(leaf):
            up, down = (value(type(leaf)(GOAL, **(gains_of(leaf) | {name: gains_of(leaf)[name] + d}))) for d in (h, -h))
            np.testing.assert_allclose(getattr(slopes, name), (up - down) / (2 * h), rtol=1e-6, atol=1e-8, err_msg=name)


def test_it_arrives(leaf):
    path = jax.jit(
        lambda leaf: rollout(leaf, jnp.asarray(GOAL) + jnp.array([1.0, -0.5, 0.3]), duration=10.0, dt=0.005)
    )(leaf)
    np.testing.assert_allclose(path.q[-1], GOAL, atol=1e-2)


def test_no_retrace(leaf, traces_of):
    assert traces_of(leaf, jnp.asarray(GOAL)) == 1


@pytest.mark.parametrize("kind", [Attractor, StretchedAttractor])
@pytest.mark.parametrize(
    ("name", "value", "wanted"),
    [
        ("width", 0.0, "a positive number"),
        ("sharpness", -1.0, "a positive number"),
        ("gain", -0.5, "a number that is not negative"),
        ("weight_far", np.nan, "a number that is not negative"),
        ("damping_rate", -2.0, "a number that is not negative"),
    ],
)
def test_bad_parameters_are_named(kind, name, value, wanted):
    with pytest.raises(ConfigurationError, match=re.escape(f"{name} of {kind.__name__} is {value}, expected {wanted}")):
        kind(jnp.zeros(3), **{name: value})
    jax.jit(lambda value: kind(jnp.zeros(3), **{name: value}).metric(jnp.ones(3), jnp.ones(3)))(value)  # not checked
