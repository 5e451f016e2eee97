"""Derivatives of what moves with the joints, by their axes: against differences, and how long programs are."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp.kinematics import ControlPoints, FrameRotation, forward_kinematics
from jaxrmp.world import SelfDistances

FRAMES = {
    "panda": ("panda_link7", "panda_hand", "panda_link4", "panda_link7", "panda_rightfinger", "panda_link0"),
    "branching": ("left_tool", "right_finger", "column", "right_hook", "left_tool", "site:left_lower", "world"),
}
STEP = 1e-5


def points_at(robot, offsets):
    return ControlPoints(robot, FRAMES[robot.name], offsets)


def everything_of(robot):
    frames = FRAMES[robot.name]

    def everything(q, qd, offsets):
        turn = FrameRotation(robot, frames[0]).pushforward(q, qd)
        pairs = SelfDistances(points_at(robot, offsets), ((0, 2), (1, 5)), np.full(len(frames), 0.01))
        carried = points_at(robot, offsets).pushforward(q, qd)
        return turn, carried, pairs.pushforward(q, qd), forward_kinematics(robot, q, frames[1])

    return everything


@pytest.fixture
def case(oracle, random_configurations):
    robot, rng = oracle.robot, np.random.default_rng(3)
    offsets = rng.uniform(-0.3, 0.3, (len(FRAMES[robot.name]), 3))
    states = [(q, rng.normal(size=q.shape), offsets) for q in random_configurations(robot, 3)]
    with jax.enable_x64(True):
        yield robot, states, rng


def apart(function, at, towards):
    """Its change along `towards`, by central differences."""
    ahead, behind = (function(*(a + s * STEP * t for a, t in zip(at, towards, strict=True))) for s in (1, -1))
    return jax.tree.map(lambda a, b: (a - b) / (2 * STEP), ahead, behind)


def test_they_are_what_differences_say(case):
    robot, states, rng = case
    everything = jax.jit(everything_of(robot))
    slopes = jax.jit(lambda at, towards: jax.jvp(everything_of(robot), at, towards)[1])
    for at in states:
        towards = tuple(rng.normal(size=a.shape) for a in at)
        ours, theirs = slopes(at, towards), apart(everything, at, towards)
        jax.tree.map(lambda a, e: np.testing.assert_allclose(a, e, rtol=1e-6, atol=1e-6), ours, theirs)


def test_so_are_the_slopes_of_gradients(case):
    robot, states, rng = case
    found = jax.eval_shape(everything_of(robot), *states[0])
    weights = [rng.normal(size=leaf.shape) for leaf in jax.tree.leaves(found)]

    def weighted(*at):
        return sum(
            jnp.sum(w * leaf) for w, leaf in zip(weights, jax.tree.leaves(everything_of(robot)(*at)), strict=True)
        )

    gradient = jax.grad(weighted, argnums=(0, 1, 2))
    slopes = jax.jit(lambda at, towards: jax.jvp(gradient, at, towards)[1])
    for at in states[:2]:
        towards = tuple(rng.normal(size=a.shape) for a in at)
        ours, theirs = slopes(at, towards), apart(jax.jit(gradient), at, towards)
        jax.tree.map(lambda a, e: np.testing.assert_allclose(a, e, rtol=1e-5, atol=1e-5), ours, theirs)


def test_in_a_batch_and_in_single_precision_they_are_the_same(case):
    robot, states, _ = case
    whole = tuple(np.stack(parts) for parts in zip(*states, strict=True))

    def energy(q, qd, offsets):
        carried = points_at(robot, offsets).pushforward(q, qd)
        return jnp.sum(carried.yd**2) + jnp.sum(carried.c * carried.y)

    gradient = jax.grad(energy, argnums=(0, 1, 2))
    together = jax.jit(jax.vmap(gradient))(*whole)
    for k, at in enumerate(states):
        alone = jax.jit(gradient)(*at)
        jax.tree.map(lambda a, e, k=k: np.testing.assert_allclose(a[k], e, rtol=1e-9, atol=1e-11), together, alone)
        single = jax.jit(gradient)(*(jnp.asarray(a, jnp.float32) for a in at))
        assert all(a.dtype == jnp.float32 for a in single)
        jax.tree.map(lambda a, e: np.testing.assert_allclose(a, e, rtol=1e-3, atol=1e-3), single, alone)


def test_their_programs_are_short(oracle):
    robot = oracle.robot
    q = jnp.zeros(robot.num_joints)
    offsets = jnp.full((len(FRAMES[robot.name]), 3), 0.1)

    def energy(q, qd):
        carried = points_at(robot, offsets).pushforward(q, qd)
        return jnp.sum(carried.yd**2) + jnp.sum(carried.c * carried.y)

    once, slopes = (length(jax.make_jaxpr(f)(q, q).jaxpr) for f in (energy, jax.grad(energy, argnums=(0, 1))))
    assert slopes < 1.7 * once, f"{slopes} operations for the gradient of {once}"


def length(jaxpr) -> int:
    inner = [p for equation in jaxpr.eqns for p in jax.tree.leaves(equation.params) if hasattr(p, "jaxpr")]
    return len(jaxpr.eqns) + sum(length(getattr(p.jaxpr, "jaxpr", p.jaxpr)) for p in inner)
