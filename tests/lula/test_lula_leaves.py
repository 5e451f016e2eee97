"""The leaves of the Lula family against their formulas written out in NumPy, and their derivatives at the edges."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, RobotError, uncertified_leaves
from jaxrmp.leaves.lula import (
    AxisTarget,
    Collision,
    CSpaceTarget,
    Inertia,
    JointLimit,
    JointVelocityCap,
    PositionTarget,
    SpeedDamping,
)

LOWER, UPPER = np.array([-2.0, -0.5, -np.inf]), np.array([1.0, 2.5, np.inf])
TARGET3, AXIS = np.array([0.3, -0.2, 0.5]), np.array([0.0, 0.6, 0.8])


def sig(z):
    return 1 / (1 + math.exp(z)) if z < 700 else 0.0


def cspace_target(x, xd):
    offset = TARGET3 - x
    far = np.linalg.norm(offset)
    if far > 0.5:
        offset = 0.5 * offset / far
    return 50 * (100 * offset - 50 * xd), 50 * np.eye(3)


def inertia(x, xd):
    return np.zeros(3), 7 * np.eye(3)


def position_target(x, xd):
    delta = TARGET3 - x
    r = np.linalg.norm(delta)
    a = 50 * delta / (r + 0.075) - 75 * xd
    alpha = (1 - 0.03) * math.exp(-(r**2) / (2 * 0.05**2)) + 0.03
    beta = math.exp(-(r**2) / (2 * 0.02**2))
    along = np.outer(delta, delta) / r**2 if r > 0 else np.zeros((3, 3))
    M = (beta * 20 + 1 - beta) * (alpha * 10000 * np.eye(3) + (1 - alpha) * 5000 * along)
    return M @ a, M


def axis_target(x, xd):
    return 10 * (210 * (AXIS - x) - 60 * xd), 10 * np.eye(3)


def boosted_axis_target(x, xd):
    r = np.linalg.norm(TARGET3 - x[3:])
    beta = math.exp(-(r**2) / (2 * 0.02**2))
    m = 10 * (beta * 3000 + 1 - beta)
    f = np.concatenate([m * (210 * (AXIS - x[:3]) - 60 * xd[:3]), np.zeros(3)])
    return f, np.diag([m, m, m, 0, 0, 0])


def joint_limit(x, xd):
    f, M = np.zeros(3), np.zeros((3, 3))
    for i in range(2):
        span = UPPER[i] - LOWER[i]
        for distance, J in (((x[i] - LOWER[i]) / span, 1 / span), ((UPPER[i] - x[i]) / span, -1 / span)):
            y, yd = max(distance, 0), J * xd[i]
            a = 1 / (y**2 / 0.1**2 + 1e-2) - 200 * yd
            m = sig(yd / 0.01) * 1000 / (y / 0.01 + 1e-3)
            f[i] += J * m * a
            M[i, i] += J * m * J
    return f, M


def joint_velocity_cap(x, xd):
    f, M = np.zeros(3), np.zeros((3, 3))
    for i in range(3):
        s = abs(xd[i]) - (1.7 - 0.35)
        if s >= 0:
            M[i, i] = 2000 / max(1 - s**2 / 0.35**2, 1e-3)
            f[i] = -M[i, i] * 10 * np.sign(xd[i]) * s
    return f, M


def collision(x, xd):
    f, M = np.zeros(3), np.zeros((3, 3))
    for i in range(3):
        d = max(x[i], 0)
        a = 800 * math.exp(-d / 0.01) - 50 * sig(xd[i] / 0.01) * xd[i] / (d / 0.04 + 1e-2)
        M[i, i] = sig(xd[i] / 0.01) * (1 - d / 0.5) ** 2 * 1e4 / (d / 0.02 + 1e-3) if d <= 0.5 else 0
        f[i] = M[i, i] * a
    return f, M


def speed_damping(x, xd):
    speed = np.linalg.norm(xd)
    return -50 * speed * 30 * speed * xd, 50 * speed * np.eye(3)


HERE = np.array([0.31, -0.19, 0.49])
CASES = {
    "cspace target, near": (CSpaceTarget(TARGET3), cspace_target, 0.1 + TARGET3, [0.2, -0.1, 0.3]),
    "cspace target, far": (CSpaceTarget(TARGET3), cspace_target, 1.0 - TARGET3, [0.2, -0.1, 0.3]),
    "inertia": (Inertia(7.0), inertia, HERE, [0.2, -0.1, 0.3]),
    "position target, near": (PositionTarget(TARGET3), position_target, HERE, [0.2, -0.1, 0.3]),
    "position target, far": (PositionTarget(TARGET3), position_target, 1 + HERE, [0.2, -0.1, 0.3]),
    "position target, 1e-4 away": (PositionTarget(TARGET3), position_target, TARGET3 + [1e-4, 0, 0], [0.2, -0.1, 0.3]),
    "position target, reached": (PositionTarget(TARGET3), position_target, TARGET3, [0.2, -0.1, 0.3]),
    "axis target": (AxisTarget(AXIS), axis_target, [1.0, 0.0, 0.0], [0.2, -0.1, 0.3]),
    "axis target with position": (
        *(AxisTarget(AXIS, TARGET3), boosted_axis_target, [1.0, 0.0, 0.0, *HERE], [0.2, -0.1, 0.3, 0.5, 0.1, -0.4]),
    ),
    "joint limit": (JointLimit(LOWER, UPPER), joint_limit, [0.98, -0.46, 30.0], [0.02, -0.03, 9.0]),
    "joint limit, beyond": (JointLimit(LOWER, UPPER), joint_limit, [1.1, -0.6, 0.0], [0.02, -0.03, 0.0]),
    "velocity cap": (JointVelocityCap(), joint_velocity_cap, HERE, [1.3, -1.5, 2.9]),
    "collision": (Collision(), collision, [0.04, 0.3, 0.6], [-0.03, 0.02, -0.01]),
    "collision, inside": (Collision(), collision, [-0.04, 0.0, 1000.0], [-0.03, 0.02, 0.0]),
    "collision, fast": (Collision(), collision, [0.04, 0.3, 0.1], [-30.0, 20.0, 900.0]),
    "damping": (SpeedDamping(), speed_damping, HERE, [0.2, -0.1, 0.3]),
    "damping, at rest": (SpeedDamping(), speed_damping, HERE, [0.0, 0.0, 0.0]),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_a_leaf_is_its_formula(case):
    leaf, formula, x, xd = case
    with jax.enable_x64(True):
        x, xd = np.asarray(x, float), np.asarray(xd, float)
        form = jax.jit(leaf)(x, xd)
        f, M = formula(x, xd)
        np.testing.assert_allclose(form.f, f, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(form.M, M, rtol=1e-9, atol=1e-12)
    assert np.linalg.eigvalsh(M).min() >= 0


EDGES = {
    "cspace target reached": (CSpaceTarget(TARGET3), TARGET3, [0.0, 0.0, 0.0]),
    "position target reached": (PositionTarget(TARGET3), TARGET3, [0.0, 0.0, 0.0]),
    "axis and position reached": (AxisTarget(AXIS, TARGET3), [*AXIS, *TARGET3], [0.0] * 6),
    "at a joint limit, and a joint without": (JointLimit(LOWER, UPPER), [-2.0, 2.5, 0.0], [0.0, 0.0, 0.0]),
    "at rest, and at the start and the pole of the cap": (JointVelocityCap(), [0.0, 0.0, 0.0], [0.0, -1.35, 1.7]),
    "contact, edge of reach, no obstacle": (Collision(), [0.0, 0.5, 1000.0], [0.0, 0.0, 0.0]),
    "speed zero": (SpeedDamping(), [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
}


@pytest.mark.parametrize("case", EDGES.values(), ids=EDGES.keys())
def test_derivatives_are_finite_at_the_edges_of_a_leaf(case):
    leaf, x, xd = case
    x, xd = jnp.asarray(x, float), jnp.asarray(xd, float)

    def both(leaf, x, xd):
        form = leaf(x, xd)
        return jnp.concatenate([form.f, form.M.reshape(-1)])

    slopes = jax.jit(jax.jacrev(both, argnums=(0, 1, 2)))
    to_gains, *to_state = slopes(jax.tree.map(jnp.asarray, leaf), x, xd)
    if not isinstance(leaf, JointLimit):  # an infinite limit has no derivative worth having
        assert all(np.isfinite(g).all() for g in jax.tree.leaves(to_gains))
    assert all(np.isfinite(slope).all() for slope in to_state)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_a_leaf_survives_jit_and_vmap_in_its_precision(case):
    leaf, _, x, xd = case
    x, xd = jnp.asarray(x, jnp.float32), jnp.asarray(xd, jnp.float32)
    alone = leaf(x, xd)
    batch = jax.jit(jax.vmap(lambda leaf, x, xd: leaf(x, xd), in_axes=(None, 0, 0)))(
        leaf, jnp.stack([x, x + 0.1]), jnp.stack([xd, xd])
    )
    assert alone.f.dtype == alone.M.dtype == batch.f.dtype == jnp.float32
    np.testing.assert_allclose(batch.f[0], alone.f, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(batch.M[0], alone.M, rtol=1e-4, atol=1e-3)


def test_distances_give_a_form_without_a_large_matrix():
    d, dd = jnp.linspace(0.01, 0.6, 5000), jnp.linspace(-0.1, 0.1, 5000)
    form = Collision().evaluate(d, dd)
    assert form.f.shape == form.d.shape == (5000,)


def test_distances_as_points_give_the_same_leaf():
    d, dd = jnp.array([0.04, 0.3, 0.6]), jnp.array([-0.03, 0.02, -0.01])
    together, apart = Collision()(d, dd), Collision()(d[:, None], dd[:, None])
    assert apart.M.shape == (3, 1, 1)
    np.testing.assert_allclose(apart.f[:, 0], together.f)
    np.testing.assert_allclose(apart.M[:, 0, 0], jnp.diag(together.M))


def test_none_is_certified():
    tree = Inertia() + JointVelocityCap()
    assert uncertified_leaves(tree) == ("inertia", "joint_velocity_cap")
    assert tree.energy(jnp.zeros(3), jnp.ones(3)) == 0


@pytest.mark.parametrize(
    ("make", "field", "value"),
    [
        (lambda: CSpaceTarget(TARGET3, position_gain=-1.0), "position_gain of CSpaceTarget", "-1.0"),
        (lambda: Inertia(-2.0), "inertia of Inertia", "-2.0"),
        (lambda: PositionTarget(TARGET3, accel_norm_eps=0.0), "accel_norm_eps of PositionTarget", "0.0"),
        (lambda: AxisTarget(AXIS, metric_scalar=-3.0), "metric_scalar of AxisTarget", "-3.0"),
        (lambda: JointLimit(LOWER, UPPER, accel_damper_gain=-1.0), "accel_damper_gain of JointLimit", "-1.0"),
        (lambda: JointVelocityCap(velocity_damping_region=0.0), "velocity_damping_region of JointVelocityCap", "0.0"),
        (lambda: Collision(metric_modulation_radius=-0.5), "metric_modulation_radius of Collision", "-0.5"),
        (lambda: SpeedDamping(accel_d_gain=float("nan")), "accel_d_gain of SpeedDamping", "nan"),
    ],
)
def test_a_constant_out_of_range_is_refused(make, field, value):
    with pytest.raises(ConfigurationError, match=f"{field} is {value}"):
        make()


def test_an_empty_joint_range_is_refused():
    with pytest.raises(RobotError, match=r"joints \[1\] have lower \[0.5\] and upper \[0.4\]"):
        JointLimit(np.array([0.0, 0.5]), np.array([1.0, 0.4]))
