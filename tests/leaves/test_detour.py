"""The detour: certified, a slope of at most its strength, nothing far from obstacles or at the goal."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, Stack, TaskMap, Translation, pullback, pytree
from jaxrmp.leaves import Attractor, CruisingAttractor, Detour
from jaxrmp.simulation import rollout

GOAL = np.array([0.3, -0.2, 0.5])
BALL = np.array([0.0, 0.1, 0.2])


@pytree
class FromBall(TaskMap):
    """The distance of a point [3] to a ball of 5 cm, [1]."""

    center: object

    def __call__(self, x):
        return jnp.linalg.norm(x - jnp.asarray(self.center, x.dtype), keepdims=True) - 0.05


def tree(strength, center=BALL):
    return pullback(Stack((Translation(GOAL), FromBall(center))), Detour(strength))


def test_a_detour_is_certified_and_smooth(x64, assert_certified, assert_smooth):
    rng = np.random.default_rng(0)
    x, xd = rng.uniform(-0.3, 0.6, (1000, 3)), rng.normal(size=(1000, 3))
    assert_certified(tree(50.0) + Attractor(GOAL), jnp.asarray(x), jnp.asarray(xd))
    edges = np.array([[0.3, 0.0, 0.0, 0.0], [0.3, 0.0, 0.0, 0.15], [0.0, 0.0, 0.0, 0.05], [0.2, 0.1, 0.0, -0.02]])
    assert_smooth(Detour(50.0), jnp.asarray(edges), jnp.ones((4, 4)))


def test_it_pushes_by_its_strength_at_most_and_not_at_the_goal_or_beyond_its_reach(x64):
    push = jax.vmap(lambda d, z: Detour(40.0)(jnp.array([z, 0.0, 0.0, d]), jnp.zeros(4)).f)
    d = jnp.linspace(-0.02, 0.2, 500)
    away = push(d, 0 * d + 1.0)
    assert 39.9 < away[:, 3].max() <= 40.0 + 1e-9 and away[:, 3].min() >= 0
    assert (away[d >= 0.15] == 0).all()
    assert np.abs(push(d, 0 * d)).max() == 0


def test_a_point_straight_before_a_ball_goes_round_on_the_side_that_it_leans_to_with_falling_energy():
    goal, aside = np.zeros(3, np.float32), np.array([0.0, 0.05, 0.0])
    cruise = CruisingAttractor(goal, speed=0.2, damping_rate=40.0)
    ahead = Stack((Translation(goal), FromBall(np.array([0.3, 0.0, 0.0]) - aside)))
    path = rollout(cruise + pullback(ahead, Detour(8.0 * 1.2)), jnp.array([0.6, 0.0, 0.0], jnp.float32), duration=20.0)
    assert np.linalg.norm(path.q[-1]) < 1e-3
    assert (np.linalg.norm(np.asarray(path.q) - [0.3, 0.0, 0.0], axis=1) > 0.05).all()
    assert np.asarray(path.q)[:, 1].max() > 0.04 and np.asarray(path.q)[:, 1].min() > -1e-4
    assert np.diff(np.asarray(path.energy, float)).max() < 1e-4 * np.ptp(path.energy)


def test_a_detour_says_what_it_must_be(assert_single, traces_of):
    assert_single(Detour(3.0), np.ones(5), np.ones(5))
    assert traces_of(Detour(3.0), jnp.ones(4)) == 1
    with pytest.raises(ConfigurationError, match="strength"):
        Detour(-1.0)
    with pytest.raises(ConfigurationError, match="reach"):
        Detour(1.0, reach=0.0)
