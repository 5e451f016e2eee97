"""The leaves that come with a flow: cruising to a point, and the funnel back to known postures."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from jaxrmp import ConfigurationError
from jaxrmp.leaves import CruisingAttractor, Damping, Funnel
from jaxrmp.simulation import rollout

GOAL = np.array([0.3, -0.2, 0.5])
PATH = np.linspace([0.0, 0.0, 0.0], [1.0, 0.5, 0.0], 20)


def states(spread=1.0, count=1000):
    rng = np.random.default_rng(0)
    return spread * rng.normal(size=(count, 3)), rng.normal(size=(count, 3))


def test_cruising_is_certified_and_smooth(x64, assert_certified, assert_smooth):
    leaf = CruisingAttractor(jnp.asarray(GOAL), weight=2.0, speed=0.3, damping_rate=7.0, taper=0.1)
    x, xd = states()
    assert_certified(leaf, jnp.asarray(GOAL + x), jnp.asarray(xd))
    assert_smooth(leaf, jnp.asarray(GOAL + np.array([0 * x[0], 1e-9 + 0 * x[0], x[0]])), jnp.asarray(xd[:3]))


def test_cruising_keeps_its_speed_on_a_straight_line_and_ends_at_the_goal():
    leaf = CruisingAttractor(np.zeros(3), speed=0.5, damping_rate=20.0, taper=0.05)
    start = np.array([1.0, 0.5, -0.2])
    path = rollout(leaf, jnp.asarray(start, jnp.float32), duration=10.0, dt=0.005)
    q, speed = np.asarray(path.q), np.linalg.norm(path.qd, axis=1)
    np.testing.assert_allclose(speed[100:300], 0.5, rtol=1e-3)
    assert np.abs(np.cross(q, start)).max() < 1e-4
    assert np.linalg.norm(q[-1]) < 1e-4


def test_the_well_of_cruising_is_the_integral_of_its_pull(x64):
    leaf = CruisingAttractor(np.zeros(1), weight=2.0, speed=0.3, damping_rate=7.0, taper=0.1)
    for r in (1e-4, 0.01, 0.05, 0.4, 3.0):
        well, _ = quad(lambda r: 2.0 * 0.3 * 7.0 * np.tanh(r / 0.1), 0, r)
        np.testing.assert_allclose(leaf.potential(jnp.array([r])), well, rtol=1e-9)


def test_a_funnel_is_nothing_inside_and_certified_everywhere(x64, assert_certified, assert_smooth):
    left = np.linspace(1.1, 0, len(PATH))
    leaf = Funnel(jnp.asarray(PATH), jnp.asarray(left), weight=2.0, inner=0.3, onset=0.3, outer=0.9)
    x, xd = states(1.2)
    faint = replace(leaf, within=0.1)
    for funnel in (leaf, faint, replace(leaf, left=0.0), replace(leaf, onset=0.0), replace(leaf, onset=0.5)):
        assert_certified(funnel + Damping(1e-3), jnp.asarray(x), jnp.asarray(xd))
    assert_smooth(faint, jnp.asarray(x[:5]), jnp.asarray(xd[:5]))
    assert_smooth(leaf, jnp.asarray(x[:5]), jnp.asarray(xd[:5]))
    inside = PATH + 0.25 / np.sqrt(3) * np.array([0.5, -1.0, 1.0])
    for at, speed in zip(inside, xd, strict=False):
        form = leaf(jnp.asarray(at), jnp.asarray(speed))
        assert not np.asarray(form.f).any() and not np.asarray(form.M).any()
        assert leaf.energy(jnp.asarray(at), jnp.asarray(speed)) == 0


def test_the_well_of_a_funnel_is_the_integral_of_its_share(x64):
    leaf = Funnel(np.zeros((1, 1)), weight=2.0, speed=0.5, damping_rate=3.0, inner=0.3, outer=0.9)
    share = lambda d: float(leaf.metric(jnp.array([d]), jnp.zeros(1))[0, 0]) / 2.0  # noqa: E731
    for d in (0.2, 0.4, 0.7, 1.0, 2.0):
        well, _ = quad(share, 0, d, limit=200)
        np.testing.assert_allclose(leaf.potential(jnp.array([d])), 2.0 * 0.5 * 3.0 * well, rtol=1e-4, atol=1e-12)


def test_a_funnel_leads_back_into_its_tube_from_everywhere():
    leaf = Funnel(PATH, inner=0.3, outer=0.6)
    start = jnp.asarray(np.random.default_rng(1).uniform(-3, 3, (20, 3)), jnp.float32)
    end = jax.vmap(lambda q: rollout(leaf + Damping(1e-3, 5.0), q, duration=8.0, dt=0.005).q[-1])(start)
    assert float(jax.vmap(leaf.distance)(end).max()) < 0.35


def test_a_funnel_that_leads_goes_along_its_way_as_well():
    way, left = np.linspace([0.0, 0.0], [2.0, 0.0], 40), np.linspace(2.0, 0.0, 40)
    aside = [Funnel(way, length)(jnp.array([0.7, 1.5]), jnp.zeros(2)).f for length in (0.0, left, 2 * left)]
    along = np.array([f[0] / -f[1] for f in aside])
    assert abs(along[0]) < 0.05 and 0.5 < along[1] < 2 and along[2] > along[1]


def test_one_that_leads_before_it_walls_in_leads_on_what_its_wall_holds():
    """Where it pulls back with a given force, it pulls on the more the earlier it begins to: else tasks rest there."""
    way, left = np.linspace([0.0, 0.0], [2.0, 0.0], 40), np.linspace(1.4, 0.0, 40)
    aside = jnp.stack([jnp.full(400, 0.7), jnp.linspace(0.3, 2.5, 400)], axis=1)

    def along_where_back_is(strength, onset):
        leaf = Funnel(way, left, weight=10.0, inner=1.2, onset=onset, outer=2.2)
        f = np.asarray(jax.vmap(lambda x: leaf(x, jnp.zeros(2)).f)(aside))
        return f[np.argmax(-f[:, 1] > strength), 0]

    for strength in (20.0, 100.0):
        late, early = (along_where_back_is(strength, onset) for onset in (1.2, 0.5))
        assert early > 1.5 * late > 0


def test_the_energy_falls_in_steps_of_a_millisecond_down_the_wall_of_a_wide_funnel():
    """Inertia goes with the wall: where that is narrow, what falls down keeps its energy and is too fast for a step."""
    way, left = np.linspace([0.0, 0.0], [2.0, 0.0], 40), np.linspace(1.0, 0.0, 40)
    tree = Funnel(way, left, weight=18.0, inner=0.8, onset=0.8, outer=2.0) + Damping(0.3, 5.0)
    start = jnp.asarray(np.random.default_rng(1).uniform([-2.0, -2.0], [3.0, 2.0], (30, 2)), jnp.float32)
    paths = jax.jit(jax.vmap(lambda q: rollout(tree, q, duration=4.0, dt=0.001)))(start)
    energy = np.asarray(paths.energy, float)
    rise = energy - np.minimum.accumulate(energy, axis=1)
    assert (rise.max(1) <= 1e-3 * np.maximum(np.ptp(energy, axis=1), 1e-3)).all()
    assert np.abs(np.asarray(paths.qd)).max() < 4.0  # speed is 1, and along the way as much again


def test_a_funnel_says_what_it_must_be():
    with pytest.raises(ConfigurationError, match=r"inner of Funnel is 0\.0, expected a positive number"):
        Funnel(PATH, inner=0.0)
    with pytest.raises(ConfigurationError, match="expected inner < outer"):
        Funnel(PATH, inner=1.0, outer=0.8)
    with pytest.raises(ConfigurationError, match="expected onset < outer"):
        Funnel(PATH, onset=1.0, outer=0.8)
