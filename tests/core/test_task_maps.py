"""Every task map against autodiff and finite differences, and the laws of composition and stacking."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import (
    Affine,
    ConfigurationError,
    Distance,
    Identity,
    Pointwise,
    RigidTransform,
    RigidTransformError,
    Selection,
    ShapeError,
    Translation,
    compose,
    pushforward,
    stack,
)
from jaxrmp._task_map import check_rigid, pushforward_by_autodiff

pytestmark = pytest.mark.usefixtures("x64")


def pose(seed=0):
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Q * np.sign(np.linalg.det(Q)), rng.normal(size=3)
    return T


@pytest.fixture
def vector_maps(random_map):
    """Maps of a vector [3], by name."""
    rng = np.random.default_rng(7)
    A, b, origin = (jnp.asarray(rng.normal(size=s)) for s in ((2, 3), (2,), (3,)))
    there, back = random_map(0, 3, 5), random_map(1, 5, 3)
    return {
        "identity": Identity(),
        "selection": Selection((2, 0)),
        "affine": Affine(A, b),
        "rigid": RigidTransform(jnp.asarray(pose())),
        "translation": Translation(origin),
        "distance": Distance(origin, 0.3),
        "plain": random_map(2, 3, 4),
        "composition": compose(there, Selection((4, 1, 1)), RigidTransform(jnp.asarray(pose(1))), Distance(origin)),
        "composition of compositions": compose(compose(there, back), compose(Translation(origin), Affine(A, b))),
        "stack": stack(Identity(), Distance(origin), compose(there, back)),
        "composition to points": compose(there, back, points_of_vector, Pointwise(Distance(origin))),
        "stack of points": stack(points_of_vector, compose(random_map(3, 3, 3), points_of_vector)),
    }


@jax.tree_util.Partial
def points_of_vector(x):
    """[3] -> [2, 3]: a plain function to two points."""
    return jnp.stack([jnp.sin(x), x * x[::-1]])


def test_pushforwards_agree_with_autodiff_and_finite_differences(vector_maps):
    rng = np.random.default_rng(3)
    h = 1e-5

    @jax.jit
    def evaluate(maps, x, xd):
        def one(psi):
            ends = [jnp.stack([psi(x + s * h * e) for e in jnp.eye(3)], axis=-1) for s in (1, -1)]
            # Along x + t xd, y is differentiated twice by central differences to check J xd and c.
            path = [psi(x + t * h * 10 * xd) for t in (-1, 0, 1)]
            numeric = (ends[0] - ends[1]) / (2 * h), (path[2] - 2 * path[1] + path[0]) / (10 * h) ** 2
            return pushforward(psi, x, xd), pushforward_by_autodiff(psi, x, xd), numeric

        return {name: one(psi) for name, psi in maps.items()}

    for _ in range(3):
        x, xd = rng.normal(size=3), rng.normal(size=3)
        for name, (ours, autodiff, (J, c)) in evaluate(vector_maps, x, xd).items():
            for part, a, e in zip(ours._fields, ours, autodiff, strict=True):
                np.testing.assert_allclose(a, e, rtol=1e-11, atol=1e-12, err_msg=f"{part} of {name}")
            # Truncation h^2 and rounding eps / h, or eps / (10 h)^2 for the second derivative, times sizes of about 10.
            np.testing.assert_allclose(ours.J, J, rtol=1e-7, atol=1e-8, err_msg=f"J of {name}")
            np.testing.assert_allclose(ours.c, c, rtol=1e-5, atol=1e-5, err_msg=f"c of {name}")


def test_maps_of_points_agree_with_autodiff_point_by_point(random_map):
    rng = np.random.default_rng(5)
    origin = jnp.asarray(rng.normal(size=(4, 3)))
    rigid, bend = RigidTransform(jnp.asarray(pose())), random_map(0, 3, 2)
    cases = {
        "identity": (Identity(), lambda k: Identity()),
        "rigid": (rigid, lambda k: rigid),
        "translation": (Translation(origin), lambda k: Translation(origin[k])),
        "pointwise distance": (Pointwise(Distance(origin[0], 0.1)), lambda k: Distance(origin[0], 0.1)),
        "pointwise plain": (Pointwise(bend), lambda k: bend),
        "composition": (
            compose(rigid, Translation(origin), Pointwise(bend)),
            lambda k: lambda x: bend(rigid(x) - origin[k]),
        ),
    }
    x, xd = (jnp.asarray(rng.normal(size=(4, 3))) for _ in range(2))

    @jax.jit
    def evaluate(x, xd):
        def one(whole, single):
            points = [pushforward_by_autodiff(single(k), x[k], xd[k]) for k in range(4)]
            return pushforward(whole, x, xd), [jnp.stack(part) for part in zip(*points, strict=True)]

        return {name: one(*case) for name, case in cases.items()}

    for name, (ours, expected) in evaluate(x, xd).items():
        for part, a, e in zip(ours._fields, ours, expected, strict=True):
            assert a.shape == e.shape, f"{part} of {name}"
            np.testing.assert_allclose(a, e, rtol=1e-11, atol=1e-12, err_msg=f"{part} of {name}")


def test_composition_is_the_chain_rule(random_map):
    first, second = random_map(0, 3, 4), random_map(1, 4, 2)
    x, xd = jnp.asarray([0.1, -0.4, 0.8]), jnp.asarray([1.0, 0.3, -2.0])
    whole = pushforward(compose(first, second), x, xd)
    one = pushforward(first, x, xd)
    two = pushforward(second, one.y, one.yd)
    np.testing.assert_allclose(whole.J, two.J @ one.J, rtol=1e-13)
    np.testing.assert_allclose(whole.yd, whole.J @ xd, rtol=1e-12)
    np.testing.assert_allclose(whole.c, two.J @ one.c + two.c, rtol=1e-13)


def test_composition_of_nothing_is_the_identity_and_of_one_map_that_map():
    distance = Distance(jnp.zeros(3))
    assert isinstance(compose(), Identity)
    assert compose(distance) is distance


def test_a_plain_function_of_several_points_is_refused():
    with pytest.raises(ShapeError, match=r"shape \(4, 3\), expected one axis.*Pointwise"):
        pushforward(jnp.sin, jnp.ones((4, 3)), jnp.ones((4, 3)))


def test_a_rigid_transform_sees_world_points_from_its_frame():
    T = pose(2)
    points = np.random.default_rng(0).normal(size=(5, 3))
    seen = (np.linalg.inv(T) @ np.c_[points, np.ones(5)].T).T[:, :3]
    np.testing.assert_allclose(RigidTransform(jnp.asarray(T))(jnp.asarray(points)), seen, atol=1e-13)
    np.testing.assert_allclose(RigidTransform(jnp.asarray(T))(jnp.asarray(points[0])), seen[0], atol=1e-13)


def test_a_moving_frame_does_not_recompile_and_has_a_gradient():
    traces = []

    @jax.jit
    def distance_to_frame(transform, x):
        traces.append(1)
        return jnp.sum(transform(x) ** 2)

    for seed in range(3):
        T = jnp.asarray(pose(seed))
        value = distance_to_frame(RigidTransform(T), T[:3, 3] + 1)
        slope = jax.grad(lambda T: jnp.sum(RigidTransform(T)(jnp.zeros(3)) ** 2))(T)
        np.testing.assert_allclose(value, 3, rtol=1e-12)  # a rotation keeps |(1, 1, 1)|^2
        np.testing.assert_allclose(slope[:3, 3], 2 * T[:3, 3], rtol=1e-12)
    assert len(traces) == 1


def with_entry(index, value):
    def change(T):
        T[index] = value
        return T

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda T: T[:3], r"shape \(3, 4\), expected \[\.\.\., 4, 4\]"),
        (with_entry((0, 3), np.nan), "non-finite"),
        (with_entry((1, 1), np.inf), "non-finite"),
        (with_entry((3, 0), 0.5), r"last row \[0.5, 0.0, 0.0, 1.0\]"),
        (lambda T: T @ np.diag([1.01, 1, 1, 1]), "not orthonormal"),
        (lambda T: T @ np.diag([-1.0, 1, 1, 1]), "reflection"),
    ],
)
def test_what_is_not_a_rigid_transform_is_refused_with_the_reason(change, message):
    T = change(pose())
    with pytest.raises(RigidTransformError, match="T_world_frame.*" + message):
        RigidTransform(jnp.asarray(T))
    with pytest.raises(RigidTransformError, match="object_pose.*" + message):
        check_rigid(T, "object_pose")


def test_many_poses_at_once_are_refused():
    with pytest.raises(RigidTransformError, match=r"T_world_frame has shape \(5, 4, 4\), expected \(4, 4\)"):
        RigidTransform(np.broadcast_to(np.eye(4), (5, 4, 4)))


def test_a_pose_rounded_to_single_precision_is_still_rigid():
    for seed in range(20):
        check_rigid(pose(seed).astype(np.float32))


def test_distance_at_the_centre_has_its_value_and_a_finite_gradient():
    center = jnp.asarray([0.3, -0.1, 2.0])
    carried = pushforward(Distance(center, 0.25), center, jnp.ones(3))
    np.testing.assert_array_equal(carried.y, [-0.25])
    for part in carried:
        assert np.isfinite(part).all()
    np.testing.assert_array_equal(carried.J, np.zeros((1, 3)))
    slope, by_center = jax.grad(lambda x, c: Distance(c, 0.25)(x)[0], argnums=(0, 1))(center, center)
    assert np.isfinite(slope).all() and np.isfinite(by_center).all()
    assert np.isfinite(jax.hessian(lambda x: Distance(center)(x)[0])(center)).all()


@pytest.mark.parametrize("radius", [0.0, 0.7])
def test_distance_away_from_the_centre_and_its_curvature_do_not_depend_on_the_radius(radius):
    x, xd = jnp.asarray([3.0, 0.0, 4.0]), jnp.asarray([0.2, 1.0, -0.5])
    carried = pushforward(Distance(jnp.zeros(3), radius), x, xd)
    n = np.asarray(x) / 5
    np.testing.assert_allclose(carried.y, [5 - radius], rtol=1e-14)
    np.testing.assert_allclose(carried.J, n[None], rtol=1e-13, atol=1e-15)
    tangential = np.asarray(xd) - n * (n @ np.asarray(xd))
    np.testing.assert_allclose(carried.c, [tangential @ tangential / 5], rtol=1e-12)  # centripetal: v^2 / r


def test_single_precision_stays_single():
    x = jnp.asarray([0.1, 0.2, 0.3], jnp.float32)
    maps = [Identity(), Selection((1,)), RigidTransform(pose()), Translation(np.ones(3)), Distance(np.ones(3), 0.5)]
    for psi in [*maps, Affine(np.eye(3), np.ones(3))]:
        for part, a in zip(["y", "yd", "J", "c"], pushforward(psi, x, x), strict=True):
            assert a.dtype == jnp.float32, f"{part} of {psi}"


def test_a_negative_radius_is_refused():
    with pytest.raises(ConfigurationError, match=r"radius of Distance is -0.1: it must not be negative"):
        Distance(jnp.zeros(3), -0.1)
