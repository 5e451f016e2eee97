"""The environment is pure, batched, and honest about what an action does to the certificate."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, ShapeError
from jaxrmp._pytree import single
from jaxrmp.environments import reset, residual_certificate, step, step_or_reset
from jaxrmp.world import Spheres, World

# One compiled program of each for the whole file.
RESET = jax.jit(jax.vmap(reset, (None, 0)))
STEP = jax.jit(jax.vmap(step_or_reset, (None, 0, 0)))
KEYS = jax.random.split(jax.random.key(0), 4)
NONE = jnp.zeros((4, 3))


@pytest.fixture(scope="module")
def begun(environment):
    return RESET(environment, KEYS)


def run(environment, state, action, steps):
    found = []
    for _ in range(steps):
        found.append(STEP(environment, state, action))
        state = found[-1].state
    return found


def test_without_an_action_the_energy_falls_and_nothing_is_put_in(environment, begun):
    state, seen = begun
    assert seen.shape == (4, environment.size) == (4, 13)
    assert (np.ptp(seen[:, :3], axis=0) > 0.01).all() and np.abs(seen[:, :3] - environment.start).max() <= 0.1 + 1e-6
    found = run(environment, state, NONE, 19)
    energy = np.array([state.asked.energy, *(each.told.energy for each in found)])
    assert (np.diff(energy, axis=0) < 1e-4 * energy[0]).all() and (energy[-1] < 0.9 * energy[0]).all()
    assert (found[-1].told.put_in < 1e-5 * energy[0]).all() and not found[-1].told.touched.any()
    assert (found[-1].reward == -found[-1].told.distance).all()


def test_an_action_puts_in_the_energy_that_the_balance_lacks(environment, begun):
    state, _ = begun
    action = jnp.tile(jnp.array([0.3, -0.3, 0.3]), (4, 1))
    before = state.asked.energy
    found = run(environment, state, action, 3)
    still = run(environment, state, NONE, 3)
    more = (found[-1].told.energy - before) - (still[-1].told.energy - before)
    assert (found[-1].told.put_in > 0.1).all() and (more > 0).all()
    there = jax.tree.map(lambda a: a[0], found[-1].state)
    certificate = jax.jit(residual_certificate)
    free, pushed = (certificate(environment, there, a) for a in (jnp.zeros(3), action[0]))
    assert free.voided_by == pushed.voided_by == ("residual",)
    assert free.residual < 1e-3 and pushed.residual > 0.01  # of the law dV/dt = -dissipation


def test_accelerations_keep_their_limits(environment, begun):
    state, _ = begun
    tight = replace(environment, acceleration_limit=np.full(3, 0.5, np.float32))
    found = STEP(tight, state, jnp.ones((4, 3)))
    assert np.abs(found.state.motion.qd).max() == pytest.approx(0.5 * environment.dt, rel=1e-4)
    assert (np.abs(STEP(environment, state, 9 * jnp.ones((4, 3))).told.action) == 1).all()


def test_an_episode_is_cut_at_its_length_or_ends_at_a_touch_and_another_begins(environment, begun):
    state, _ = begun
    *_, last, after = run(environment, state, NONE, environment.length + 1)
    assert last.truncated.all() and not last.terminated.any() and last.state.over.all()
    assert (after.state.steps == 0).all() and (after.reward == 0).all() and not after.state.over.any()
    assert np.abs(after.observation[:, :3] - environment.start).max() <= 0.1 + 1e-6
    assert np.abs(after.observation[:, :3] - begun[1][:, :3]).max() > 0.01  # drawn anew
    ball = single(World(spheres=Spheres.of([((0.72, -0.22, 0.0), 0.1)], capacity=2)))
    inside = STEP(replace(environment, world=ball), state, NONE)
    assert inside.terminated.all() and not inside.truncated.any() and (inside.reward < -9).all()


def test_mistakes_are_explained(environment):
    with pytest.raises(ConfigurationError, match="length is 0"):
        replace(environment, length=0)
    for wrong in ({"acceleration_limit": np.zeros(3)}, {"largest": np.full(3, np.nan)}, {"spread": -0.1}):
        with pytest.raises(ConfigurationError, match=next(iter(wrong))):
            replace(environment, **wrong)
    with pytest.raises(ConfigurationError, match="2 slots for obstacles and the policy no spheres"):
        replace(environment, policy=replace(environment.policy, spheres=None))


def test_shapes_that_would_broadcast_are_refused(environment, begun):
    key, state = KEYS[0], jax.tree.map(lambda a: a[0], begun[0])
    for name in ("start", "largest", "acceleration_limit"):
        with pytest.raises(ShapeError, match=rf"{name} has shape \(1,\), expected \(3,\)"):
            reset(replace(environment, **{name: np.ones(1)}), key)
    with pytest.raises(ShapeError, match=r"target_spread has shape \(2,\), expected \(\) or \(3,\)"):
        reset(replace(environment, target_spread=np.ones(2)), key)
    for judged in (step, residual_certificate):
        with pytest.raises(ShapeError, match=r"action has shape \(1,\), expected \(3,\)"):
            judged(environment, state, np.ones(1))
