"""The stable step: known rates, and what rollouts do on both sides of it."""

import dataclasses
import re
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import GeometricDynamicalSystem, RolloutError, pullback
from jaxrmp.simulation import StiffnessWarning, rollout, stable_step, warn_if_stiff


@pytest.fixture(autouse=True)
def x64():
    with jax.enable_x64(True):
        yield


def linear(mass, stiffness, damping):
    """`mass xdd = -stiffness x - damping xd`, coordinate by coordinate."""
    mass, stiffness, damping = (jnp.asarray(a) for a in (mass, stiffness, damping))
    return GeometricDynamicalSystem.of(
        Partial(lambda a, x, xd: jnp.diag(a), mass),
        Partial(lambda a, x: 0.5 * jnp.sum(a * x * x), stiffness),
        Partial(lambda a, x, xd: jnp.diag(a), damping),
    )


X, V = np.array([0.3, -0.2]), np.array([1.0, 0.5])


def test_known_rates():
    # rates damping / mass = 20 and 5 per second; stiffnesses 0
    assert stable_step(linear([2.0, 1.0], [0.0, 0.0], [40.0, 5.0]), X, V) == pytest.approx(2 / 20)
    assert stable_step(linear([2.0, 1.0], [800.0, 9.0], [0.0, 0.0]), X, V) == pytest.approx(2 / 20)
    assert stable_step(linear([1.0], [100.0], [30.0]), X[:1], V[:1]) == pytest.approx(4 / (30 + np.sqrt(1300)))
    assert stable_step(linear([1.0, 1.0], [0.0, 0.0], [0.0, 0.0]), X, V) == np.inf


def test_rates_are_seen_through_task_maps():
    policy = pullback(lambda q: 3.0 * q, linear([2.0, 1.0], [0.0, 0.0], [40.0, 5.0])) + linear(
        [18.0, 0.0], [0.0, 0.0], [0.0, 0.0]
    )
    assert stable_step(policy, X, V) == pytest.approx(2 / 10)  # metric 18 + 18, damping 360


@pytest.mark.parametrize("stiffness", [0.0, 100.0])
def test_rollouts_settle_below_it_and_grow_above_it(stiffness):
    policy = linear([2.0], [2 * stiffness], [40.0])
    h = stable_step(policy, X[:1], V[:1])
    speed = {
        s: np.abs(rollout(policy, X[:1], V[:1], duration=400 * s * h, dt=s * h, warn=False).qd[-1, 0])
        for s in (0.95, 1.05)
    }
    assert speed[0.95] < 1e-3 and speed[1.05] > 1e2


def test_it_warns_from_half_the_stable_step_on_and_gives_it():
    policy = linear([1.0], [0.0], [50.0])  # k dt = 1 at 20 ms
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert warn_if_stiff(policy, X[:1], V[:1], 0.019) == pytest.approx(0.04)
    with pytest.warns(
        StiffnessWarning, match=r"may ring.*times step is 1.05.*stable step here is 0.04 s.*divide the step by 2"
    ):
        warn_if_stiff(policy, X[:1], V[:1], 0.021)
    with pytest.warns(StiffnessWarning, match=r"dt = 0.1 s is unstable.*divide the step by 5"):
        warn_if_stiff(policy, X[:1], V[:1], 0.1)


def test_derivatives_that_are_not_finite_are_refused():
    singular = linear([0.0], [1.0], [1.0])
    with pytest.raises(RolloutError, match=r"not finite at q = \[0.3\]"):
        stable_step(singular, X[:1], V[:1])


def test_of_several_states_the_stiffest_counts_and_one_program_serves_all_gains():
    traces = []

    def drag(rate, x, xd):
        traces.append(1)
        return rate * jnp.diag(1 + x * x)

    policy = dataclasses.replace(linear([1.0], [0.0], [0.0]), damping_of=Partial(drag, 10.0))
    q = np.array([[0.0], [2.0], [np.nan]])
    assert stable_step(policy, q, 0 * q) == pytest.approx(2 / 50)
    before = len(traces)
    faster = dataclasses.replace(policy, damping_of=Partial(drag, 20.0))
    assert stable_step(faster, q, 0 * q) == pytest.approx(2 / 100)
    assert len(traces) == before


def test_a_rollout_with_numbers_warns_and_a_traced_one_does_not():
    policy = linear([1.0], [0.0], [50.0])
    with pytest.warns(StiffnessWarning, match=r"damping rate times step is 1.25.*longest stable step here is 0.04 s"):
        rollout(policy, X[:1], V[:1], duration=0.1, dt=0.025)
    with pytest.warns(StiffnessWarning, match="is unstable"):  # beyond the numbers themselves, too
        rollout(policy, X[:1], V[:1], duration=200.0, dt=1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rollout(policy, X[:1], V[:1], duration=0.1, dt=0.025, substeps=2)
        jax.jit(lambda q: rollout(policy, q, duration=0.1, dt=0.025))(X[:1])


@pytest.mark.parametrize(("stiffness", "start", "speed"), [(900.0, 2.0, 0.0), (1.0, 0.2, 40.0)])
def test_advice_is_of_states_before_the_rollout_diverges(stiffness, start, speed):
    """The farther out, the faster the damping; a path that diverges goes to where no step is short enough."""
    drag = Partial(lambda x, xd: jnp.diag(1.0 + 50.0 * x * x))
    policy = dataclasses.replace(linear([1.0], [stiffness], [0.0]), damping_of=drag)
    with pytest.warns(StiffnessWarning, match="is unstable") as said:
        path = rollout(policy, np.array([start]), np.array([speed]), duration=1.5, dt=0.05)
    assert not np.isfinite(path.qd).all() or np.abs(path.qd).max() > 1e6
    steps = [re.search(r"longest stable step here is (\S+) s", str(warning.message)) for warning in said]
    (advice,) = (float(step[1]) for step in steps if step)
    assert 1e-3 < advice < 0.05
