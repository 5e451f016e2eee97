"""Gains tuned by gradient through rollouts: right against finite differences, useful with optax, lean in memory."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from jax.tree_util import Partial

from jaxrmp import Affine, Distance, compose, pullback
from jaxrmp.leaves import Attractor, CollisionAvoidance, Damping, JointLimit, Learned
from jaxrmp.simulation import rollout

GOAL, CENTER, RADIUS = np.array([1.2, 1.3]), np.array([1.9, 0.3]), 0.3
STARTS = np.array([[-0.6, 0.4, 0.3], [-0.4, 0.2, 0.5]])
GAINS = {"pull": 1.0, "pull_rate": 2.0, "barrier": 1e-3, "wall_rate": 1.0, "weight": 0.02, "rate": 5.0, "limit": 0.01}


@pytest.fixture(autouse=True)
def x64():
    with jax.enable_x64(True):
        yield


def hand(q):
    angles = jnp.cumsum(q)
    return 0.8 * jnp.stack([jnp.cos(angles).sum(), jnp.sin(angles).sum()])


def policy(gains):
    to_disc = compose(Partial(hand), Distance(CENTER, RADIUS))
    return (
        pullback(Partial(hand), Attractor(GOAL, gain=gains["pull"], damping_rate=gains["pull_rate"]))
        + pullback(to_disc, CollisionAvoidance(barrier=gains["barrier"], damping_rate=gains["wall_rate"], reach=0.5))
        + Damping(gains["weight"], gains["rate"])
        + JointLimit(-2.5 * np.ones(3), 2.5 * np.ones(3), barrier=gains["limit"])
    )


def loss_of(logs, duration=3.0, dt=0.02):
    """Mean squared distance of the hand to the goal, of gains given by their logarithms."""
    tree = policy(jax.tree.map(jnp.exp, logs))
    paths = jax.vmap(lambda q: rollout(tree, q, duration=duration, dt=dt))(jnp.asarray(STARTS))
    away = jax.vmap(jax.vmap(hand))(paths.q) - GOAL
    return (away**2).sum(-1).mean()


@pytest.fixture
def logs():
    return {name: jnp.asarray(np.log(value)) for name, value in GAINS.items()}


def test_gradients_of_all_gains_equal_finite_differences(logs):
    loss = jax.jit(loss_of)
    slopes = jax.jit(jax.grad(loss_of))(logs)
    h = 1e-5
    for name in GAINS:
        ahead, behind = (loss({**logs, name: logs[name] + step}) for step in (h, -h))
        numeric = (ahead - behind) / (2 * h)
        np.testing.assert_allclose(slopes[name], numeric, rtol=1e-5, atol=1e-9, err_msg=name)
    assert all(abs(float(slopes[name])) > 1e-6 for name in ("pull", "pull_rate", "barrier", "weight", "rate"))


def test_the_gradient_reaches_every_parameter_of_the_tree_itself():
    """No functions of gains needed: the tree is a pytree, and its gradient is a tree."""
    tree = jax.tree.map(jnp.asarray, policy(GAINS))
    slope = jax.jit(jax.grad(lambda tree: (rollout(tree, STARTS[0], duration=0.5, dt=0.02).q ** 2).sum()))(tree)
    assert jax.tree.structure(slope) == jax.tree.structure(tree)
    assert all(np.isfinite(a).all() for a in jax.tree.leaves(slope))
    assert np.abs(slope.nodes[0].node.goal).max() > 0 and abs(slope.nodes[2].weight) > 0


def test_learned_gains_too():
    def loss(gains):
        leaf = Learned(Partial(lambda x: jnp.sqrt(x @ x + 1e-4)), Partial(lambda x: jnp.eye(2)), *gains)
        tree = pullback(compose(Partial(hand), Affine(np.eye(2), -GOAL)), leaf) + Damping(0.01, 5.0)
        return ((jax.vmap(hand)(rollout(tree, STARTS[0], duration=2.0, dt=0.02).q) - GOAL) ** 2).mean()

    gains = jnp.asarray([0.2, 20.0])
    slope, value = jax.jit(jax.grad(loss))(gains), jax.jit(loss)
    steps = np.diag([1e-5, 1e-3])
    numeric = [(value(gains + h) - value(gains - h)) / (2 * h.sum()) for h in steps]
    np.testing.assert_allclose(slope, numeric, rtol=1e-5)


def test_optax_lowers_the_loss(logs):
    optimiser = optax.adam(0.2)

    @jax.jit
    def update(logs, state):
        value, slope = jax.value_and_grad(loss_of)(logs)
        change, state = optimiser.update(slope, state)
        return optax.apply_updates(logs, change), state, value

    state, losses = optimiser.init(logs), []
    for _ in range(25):
        logs, state, value = update(logs, state)
        losses.append(float(value))
    assert min(losses) < 0.7 * losses[0], losses


def test_a_gradient_keeps_little_more_than_the_states(logs):
    compiled = jax.jit(jax.grad(loss_of)).lower(logs).compile()
    if (memory := compiled.memory_analysis()) is None:
        pytest.skip("this backend does not report memory")
    states = len(STARTS) * 6 * 8 * 150  # q and qd of three joints in float64, at 150 steps
    assert memory.temp_size_in_bytes < 12 * states, f"{memory.temp_size_in_bytes / states:.1f} times the states"
