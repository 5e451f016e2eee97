"""Commands keep an arm's limits, whatever is asked for."""

import dataclasses

import jax
import numpy as np
import pytest

from jaxrmp import RobotError
from jaxrmp.hardware import FR3_LIMITS, MotionLimits, brake, limited
from jaxrmp.hardware._limits import check_limits
from jaxrmp.kinematics import panda

DT = 1e-3
LIMITS = {"fr3": FR3_LIMITS, "by file": check_limits(MotionLimits.of_robot(panda()), 7)}
LIMITS["jerk 500"] = dataclasses.replace(LIMITS["by file"], jerk=np.full(7, 500.0))


@pytest.fixture(params=LIMITS)
def limits(request):
    return LIMITS[request.param]


def wild(rng, steps):
    """Accelerations [steps, 7] far beyond any limit, that jump at random and at times lean on one joint's end."""
    wanted = rng.normal(size=(steps, 7)) * 10 ** rng.uniform(-1, 3, size=(steps, 1))
    held = np.repeat(rng.normal(size=(steps // 400 + 1, 7)) * 40, 400, axis=0)[:steps]
    return np.where(rng.uniform(size=(steps, 1)) < 0.2, wanted, held)


@pytest.mark.parametrize("seed", range(3))
def test_no_limit_is_crossed_whatever_is_wanted(limits, seed):
    rng = np.random.default_rng(seed)
    steps = 6000
    wanted = wild(rng, steps)
    q = rng.uniform(limits.lower + 0.2, limits.upper - 0.2)
    with jax.enable_x64(True):

        def step(state, asked):
            q, v, a = state
            found = limited(limits, q, v, a, asked, DT)
            low, high = limits.velocity_range(q)
            q = q + DT * found.qd
            return (q, found.qd, found.qdd), (q, found.qd, found.qdd, low, high)

        zeros = np.zeros(7)
        _, (q, v, a, low, high) = jax.lax.scan(step, (q, zeros, zeros), wanted)
    q, v, a, low, high = map(np.asarray, (q, v, a, low, high))
    jerk = np.diff(np.concatenate([np.zeros((1, 7)), a]), axis=0) / DT
    assert (np.abs(jerk) <= limits.jerk).all()
    assert (np.abs(a) <= limits.acceleration).all()
    assert (v >= low - 1e-9).all() and (v <= high + 1e-9).all()
    assert (q > limits.lower).all() and (q < limits.upper).all()
    assert np.abs(v).max() > 0.5, "the arm was asked to move and did"
    reached = np.minimum(q - limits.lower, limits.upper - q).min(axis=0)
    assert (reached < 0.25).any(), "some joint was driven to the end of its range"


def test_what_is_within_limits_is_not_changed(limits):
    wanted = np.array([1.0, -0.5, 0.2, 0.0, 0.3, -0.1, 0.5])
    q = 0.5 * (limits.lower + limits.upper)
    with jax.enable_x64(True):
        found = limited(limits, q, np.full(7, 0.1), wanted, wanted, DT)
    np.testing.assert_allclose(found.qdd, wanted, atol=1e-12)
    np.testing.assert_allclose(found.qd, 0.1 + DT * wanted, atol=1e-12)
    np.testing.assert_allclose(found.cut, 0.0, atol=1e-12)


def test_too_much_is_scaled_as_a_whole():
    wanted = np.array([100.0, -50.0, 20.0, 0.0, 30.0, -10.0, 50.0])
    q = 0.5 * (FR3_LIMITS.lower + FR3_LIMITS.upper)
    zeros = np.zeros(7)
    a = zeros
    with jax.enable_x64(True):
        for _ in range(20):
            found = limited(FR3_LIMITS, q, zeros, a, wanted, DT)
            a = found.qdd
    np.testing.assert_allclose(np.asarray(found.qdd) / np.asarray(found.qdd)[0], wanted / wanted[0], atol=1e-12)
    np.testing.assert_allclose(found.cut, wanted - np.asarray(found.qdd))


def test_braking_goes_straight_on_and_ends(limits):
    q = 0.5 * (limits.lower + limits.upper)
    v, a = np.array([1.0, -0.8, 0.6, 0.4, -0.2, 0.1, 1.2]), np.zeros(7)
    began, way = v / np.linalg.norm(v), np.zeros(7)
    with jax.enable_x64(True):
        for _ in range(2000):
            found = brake(limits, q + way, v, a, DT)
            jerk = (np.asarray(found.qdd) - a) / DT
            v, a = np.asarray(found.qd), np.asarray(found.qdd)
            way = way + DT * v
            assert (np.abs(a) <= limits.acceleration).all() and (np.abs(jerk) <= limits.jerk).all()
            if np.abs(v).max() < 1e-3:
                break
    assert np.abs(v).max() < 1e-3
    np.testing.assert_allclose(way / np.linalg.norm(way), began, atol=1e-6)


@pytest.mark.parametrize("jerk", [20.0, 50.0, 100.0])
def test_an_arm_of_little_jerk_is_slow_and_neither_crosses_limits_nor_turns_back(jerk):
    limits = dataclasses.replace(LIMITS["by file"], jerk=np.full(7, jerk))
    wanted = np.array([30.0, -30.0, 30.0, 30.0, -30.0, 30.0, -30.0])
    q, v, a = 0.5 * (limits.lower + limits.upper), np.zeros(7), np.zeros(7)
    with jax.enable_x64(True):
        step = jax.jit(lambda q, v, a: limited(limits, q, v, a, wanted, DT))
        stop = jax.jit(lambda q, v, a: brake(limits, q, v, a, DT))
        for k in range(20_000):
            found = step(q, v, a)
            v, a = np.asarray(found.qd), np.asarray(found.qdd)
            q = q + DT * v
            assert (q > limits.lower).all() and (q < limits.upper).all() and (np.abs(v) <= limits.velocity).all()
            if k == 3000:
                way = (q, v, a)
        q, v, a = way
        forth = np.sign(v)
        assert (np.abs(v) > 0.05).any()
        for _ in range(20_000):
            found = stop(q, v, a)
            v, a = np.asarray(found.qd), np.asarray(found.qdd)
            q = q + DT * v
            assert (forth * v > -1e-3).all(), "it stops, and does not turn back"
    assert np.abs(v).max() < 1e-3


def test_limits_that_are_none_are_refused():
    for name, value, message in (
        ("velocity", np.zeros(7), "limits.velocity"),
        ("jerk", np.full(7, np.nan), "limits.jerk"),
        ("braking", np.zeros(7), "limits.braking"),
        ("offset", np.full(7, np.inf), "limits.offset"),
        ("lower", np.full(6, -1.0), "limits.lower"),
        ("upper", FR3_LIMITS.lower, "not below limits.upper"),
    ):
        with pytest.raises(RobotError, match=message):
            check_limits(dataclasses.replace(FR3_LIMITS, **{name: value}), 7)
