"""The first-order form: descent of the potential, and the limit of strong damping."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import (
    Batched,
    ConfigurationError,
    GeometricDynamicalSystem,
    Leaf,
    NaturalForm,
    Translation,
    acceleration,
    compose,
    pullback,
    pytree,
    static,
)
from jaxrmp._first_order import overdamped_velocity, velocity
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.leaves import JointLimit, Learned

pytestmark = pytest.mark.usefixtures("x64")


def smooth_cone(x):
    return jnp.sqrt(x @ x + 1e-4)


def bent_factor(x):
    m = x.shape[0]
    return jnp.eye(m, dtype=x.dtype) * (1 + 0.3 * jnp.cos(3 * x)) + 0.3 * jnp.tril(
        jnp.outer(jnp.sin(x), jnp.cos(x)), -1
    )


def learned(speed=0.3, damping_rate=20.0):
    return Learned(Partial(smooth_cone), Partial(bent_factor), speed, damping_rate)


def damping(weight, rate, n):
    """Damping of every joint with a metric of its own."""
    return GeometricDynamicalSystem.of(
        Partial(lambda w, x, xd: w * jnp.eye(n), weight),
        Partial(lambda x: 0.0 * x[0]),
        Partial(lambda b, x, xd: b * jnp.eye(n), weight * rate),
        "damping",
    )


def hand(q):
    angles = jnp.cumsum(q)
    return 0.8 * jnp.stack([jnp.cos(angles).sum(), jnp.sin(angles).sum()])


def planar():
    return pullback(Partial(lambda q: hand(q) - jnp.asarray([1.2, 1.3])), learned()) + damping(0.01, 5.0, 3)


def test_it_is_m_inverse_times_the_slope_of_the_energy_at_rest():
    tree = planar() + JointLimit(-3 * jnp.ones(3), 3 * jnp.ones(3))
    rest = jnp.zeros(3)

    @jax.jit
    def evaluate(q):
        slope, M = jax.grad(tree.energy)(q, rest), tree(q, rest).M
        return slope, M, velocity(tree, q), velocity(tree, q, "pinv", 0.05), acceleration(tree, q, rest)

    for q in np.random.default_rng(0).uniform(-2.9, 2.9, (10, 3)):
        slope, M, by_cholesky, by_pinv, acceleration_from_rest = evaluate(q)
        expected = -np.linalg.solve(M, slope)
        np.testing.assert_allclose(by_cholesky, expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(by_pinv, 0.05 * expected, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(by_cholesky, acceleration_from_rest, rtol=1e-10, atol=1e-10)


def test_a_learned_leaf_moves_at_its_speed_along_its_field():
    leaf = learned(speed=0.3, damping_rate=20.0)
    x = jnp.asarray([0.4, -0.7])
    fields = jax.jit(lambda x: (velocity(leaf, x, time_scale=1 / 20.0), overdamped_velocity(leaf, x), leaf.field(x)))
    *ours, field = fields(x)
    for found in ours:
        np.testing.assert_allclose(found, 0.3 * field, rtol=1e-12)


def test_it_is_where_strong_damping_takes_the_second_order_policy():
    """Unequal damping rates: the exact velocity at which the leaves' forces balance, in the limit of small metric."""
    tree, q = planar(), jnp.asarray([-0.6, 0.4, 0.3])

    @jax.jit
    def parts(q):
        at_hand = bent_factor(hand(q) - jnp.asarray([1.2, 1.3]))
        return overdamped_velocity(tree, q), -jax.grad(tree.energy)(q, jnp.zeros(3)), jax.jacfwd(hand)(q), at_hand

    expected, p, J, L = parts(q)
    B = 20.0 * J.T @ L @ L.T @ J + 0.05 * np.eye(3)
    np.testing.assert_allclose(expected, np.linalg.solve(B, p), rtol=1e-9)

    # The velocity to which qd settles with q held, as all damping rates grow at constant cruising speed.
    errors = []
    for gain in (1.0, 10.0, 100.0):
        stronger = pullback(tree.nodes[0].task_map, learned(damping_rate=20.0 * gain)) + damping(0.01, 5.0 * gain, 3)
        qd = jnp.zeros(3)
        for _ in range(30):  # Newton's iteration for acceleration(q, qd) = 0
            qd = qd - np.linalg.solve(*_balance(stronger, q, qd))
        errors.append(float(np.abs(qd - expected).max()))
    assert errors[1] < 0.2 * errors[0] and errors[2] < 0.2 * errors[1]


@jax.jit
def _balance(tree, q, qd):
    return jax.jacfwd(lambda qd: acceleration(tree, q, qd))(qd), acceleration(tree, q, qd)


def descend(tree, q, field, dt, steps):
    def step(q, _):
        return q + dt * field(tree, q), (tree.energy(q, jnp.zeros_like(q)), q)

    return jax.lax.scan(step, q, length=steps)


@pytest.mark.parametrize("field", [lambda t, q: velocity(t, q, time_scale=1 / 20.0), overdamped_velocity])
def test_the_planar_hand_descends_to_its_goal(field):
    tree = planar()
    starts = jnp.asarray([[-0.6, 0.4, 0.3], [1.8, 0.5, -0.9], [0.2, 2.0, 0.4]])
    slope = jax.jit(jax.vmap(lambda q: jax.grad(tree.energy)(q, jnp.zeros(3)) @ field(tree, q)))(starts)
    assert (slope < 0).all()
    end, (potential, _) = jax.jit(jax.vmap(lambda q: descend(tree, q, field, 0.01, 2500)))(starts)
    assert (np.diff(potential, axis=1) <= 1e-12).all()
    goal = np.asarray([1.2, 1.3])
    assert np.linalg.norm(np.asarray(jax.vmap(hand)(end)) - goal, axis=1).max() < 1e-3


def test_the_panda_descends_to_its_goal():
    robot = panda()
    q0 = jnp.asarray([0.0, -0.4, 0.0, -2.0, 0.0, 1.8, 0.8])
    points = ControlPoints(robot, "panda_hand_tcp", np.asarray([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]]))
    goals = points(jnp.asarray([0.6, 0.2, -0.3, -1.6, 0.2, 2.0, 0.5]))

    @jax.jit
    def run(goals, q):
        leaf = Batched(learned(speed=0.2), shared=True)
        tree = pullback(compose(points, Translation(goals)), leaf) + damping(1e-3, 20.0, 7)
        return descend(tree, q, lambda t, q: velocity(t, q, time_scale=1 / 20.0), 0.02, 1200)

    end, (potential, _) = run(goals, q0)
    assert (np.diff(potential) <= 1e-9).all()
    assert np.abs(np.asarray(points(end) - goals)).max() < 2e-3


@pytree
class Pull(Leaf):
    """A force that is no gradient."""

    name: str = static(default="pull")
    certified = False

    def __call__(self, x, xd):
        return NaturalForm(-x, jnp.eye(x.shape[0], dtype=x.dtype))


@pytest.mark.parametrize("field", [velocity, overdamped_velocity])
def test_leaves_without_a_potential_are_refused_by_name(field):
    tree = planar() + Pull() + Pull(name="push") + replace(Pull())
    with pytest.raises(ConfigurationError, match=r"\['pull', 'push'\] have no potential"):
        field(tree, jnp.zeros(3))


def test_it_survives_transformations():
    tree = planar()
    qs = jnp.asarray(np.random.default_rng(0).uniform(-1, 1, (4, 3)))
    out = jax.jit(jax.vmap(velocity, (None, 0)))(tree, qs)
    slope = jax.jit(jax.grad(lambda t: (velocity(t, qs[0]) ** 2).sum()))(tree)
    assert all(np.isfinite(a).all() for a in jax.tree.leaves((out, slope)))
    single = jax.eval_shape(velocity, Learned(Partial(smooth_cone), Partial(bent_factor)), jnp.ones(2, jnp.float32))
    assert single.dtype == np.float32
