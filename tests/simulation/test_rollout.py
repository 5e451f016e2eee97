"""Kinematic rollouts against SciPy's integrator."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial
from scipy.integrate import solve_ivp

from jaxrmp import GeometricDynamicalSystem, pullback
from jaxrmp.leaves import Attractor, Damping, JointLimit
from jaxrmp.simulation import StiffnessWarning, rollout
from jaxrmp.simulation._kinematic import _rolled

K, C, B = np.array([4.0, 9.0]), 0.5, np.array([0.6, 1.0])


@pytest.fixture(autouse=True)
def x64():
    with jax.enable_x64(True):
        yield


def oscillator():
    """`(1 + C |x|^2) xdd = ...`: a damped oscillator with a position-dependent mass."""
    return GeometricDynamicalSystem.of(
        Partial(lambda x, xd: (1 + C * x @ x) * jnp.eye(2)),
        Partial(lambda x: 0.5 * jnp.sum(jnp.asarray(K) * x * x)),
        Partial(lambda x, xd: jnp.diag(jnp.asarray(B))),
    )


def exact(q, qd, times):
    def motion(t, state):
        x, xd = state[:2], state[2:]
        xi = 2 * C * (x @ xd) * xd - C * (xd @ xd) * x  # Christoffel force of (1 + C |x|^2) I, by hand
        return np.concatenate([xd, (-K * x - B * xd - xi) / (1 + C * x @ x)])

    solution = solve_ivp(motion, (0, times[-1]), np.concatenate([q, qd]), t_eval=times, rtol=1e-10, atol=1e-12)
    return solution.y[:2].T, solution.y[2:].T


def test_rollouts_converge_to_the_motion_at_first_order():
    q, qd = np.array([1.0, -0.5]), np.array([0.0, 2.0])
    errors = []
    for dt in (0.02, 0.01, 0.005):
        path = jax.jit(lambda q, qd, dt=dt: rollout(oscillator(), q, qd, duration=3.0, dt=dt))(q, qd)
        assert path.q.shape == path.qd.shape == (round(3 / dt) + 1, 2)
        np.testing.assert_allclose(path.time, dt * np.arange(len(path.time)), rtol=1e-12)
        np.testing.assert_array_equal(path.q[0], q)
        np.testing.assert_array_equal(path.qd[0], qd)
        expected, velocity = exact(q, qd, np.asarray(path.time).clip(max=3.0))
        errors.append([np.abs(path.q - expected).max(), np.abs(path.qd - velocity).max()])
    errors = np.asarray(errors)
    assert (errors[-1] < 0.03).all()
    ratios = errors[:-1] / errors[1:]
    assert (ratios > 1.8).all() and (ratios < 2.2).all()  # first order: halving dt halves the error


def test_substeps_are_steps_that_are_not_recorded():
    q = jnp.asarray([1.0, -0.5])
    fine = jax.jit(lambda q: rollout(oscillator(), q, duration=1.0, dt=0.005))(q)
    coarse = jax.jit(lambda q: rollout(oscillator(), q, duration=1.0, dt=0.02, substeps=4))(q)
    for a, b in zip(jax.tree.leaves(coarse), jax.tree.leaves(fine), strict=True):
        np.testing.assert_allclose(a, b[::4], rtol=1e-11, atol=1e-12)
    np.testing.assert_array_equal(fine.qd[0], 0)  # by default from rest


def test_the_energy_of_a_certified_tree_does_not_rise_and_is_that_of_the_states():
    psi = Partial(lambda q: q[:2] + 0.3 * jnp.sin(q[1:]))
    limits = JointLimit(-3 * jnp.ones(3), 3 * jnp.ones(3), sigma=1.0)
    tree = pullback(psi, oscillator()) + limits + Damping(0.1, 3.0)
    starts = jnp.asarray(np.random.default_rng(0).uniform(-1, 1, (6, 3)))
    paths = jax.jit(jax.vmap(lambda q: rollout(tree, q, duration=8.0, dt=0.002)))(starts)
    energy = np.asarray(paths.energy)
    spread = np.ptp(energy, axis=1, keepdims=True)
    assert (np.diff(energy, axis=1) / spread).max() <= 1e-6
    assert (energy[:, -1] < energy[:, 0] - 0.1).all()
    np.testing.assert_allclose(energy[2, 100], tree.energy(paths.q[2, 100], paths.qd[2, 100]), rtol=1e-12)


def test_single_precision_rollouts_stay_single():
    path = jax.jit(lambda q: rollout(Damping(), q, duration=0.1))(jnp.zeros(2, jnp.float32))
    assert {a.dtype.name for a in jax.tree.leaves(path)} == {"float32"}


def test_a_rollout_that_is_not_finite_says_when_it_ceased_to_be():
    """The advice on the step is then of the start, not of states on their way to infinity."""
    with pytest.warns(StiffnessWarning) as caught:
        path = rollout(Damping(1.0, 3000.0), jnp.zeros(2), jnp.ones(2), duration=20.0, dt=0.1)
    assert not np.isfinite(np.asarray(path.qd)).all()
    messages = [str(warning.message) for warning in caught]
    time = float(path.time[np.isfinite(np.asarray(path.qd)).all(1).argmin()])
    assert any(f"not finite from {time:.3g} s on" in message for message in messages)
    assert any("longest stable step here is 0.000667 s" in message for message in messages)


def test_an_eager_rollout_with_other_numbers_compiles_nothing_anew():
    def roll(goal, step):
        return rollout(Attractor(jnp.full(2, goal)), jnp.zeros(2), duration=step * 40, dt=step, warn=False)

    first = roll(0.5, 0.01)
    known = _rolled._cache_size()
    second = roll(-0.3, 0.02)
    assert _rolled._cache_size() == known and not np.allclose(first.q, second.q)
