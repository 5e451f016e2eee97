"""The task maps from joint positions to distances: derivatives, and the defects that peers' maps have."""

from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from jaxrmp import ConfigurationError, ShapeError, pushforward
from jaxrmp._task_map import pushforward_by_autodiff
from jaxrmp.kinematics import ControlPoints, panda
from jaxrmp.world import (
    FAR,
    Boxes,
    CapsuleDistances,
    Capsules,
    Cylinders,
    HalfSpaces,
    ObstacleDistances,
    SelfDistances,
    SignedDistanceGrid,
    Spheres,
    World,
)

from .conftest import moving_points, random_poses, random_state, random_world

pytestmark = pytest.mark.usefixtures("x64")
carry = jax.jit(pushforward)
carry_by_autodiff = jax.jit(pushforward_by_autodiff)
RADII = jnp.asarray([0.02, 0.05, 0.0, 0.1, 0.07])


def maps(seed=0):
    world = random_world(seed)
    smooth_world = replace(world, grids=())
    a, b = moving_points(1), moving_points(2)
    return {
        "spheres to obstacles": ObstacleDistances(a, world, RADII),
        "spheres to each other": SelfDistances(a, ((0, 1), (0, 4), (3, 2)), RADII),
        "capsules to obstacles": CapsuleDistances(a, b, smooth_world, RADII),
    }


@pytest.mark.parametrize("name", list(maps()))
def test_pushforwards_agree_with_autodiff_and_finite_differences(name):
    psi = maps()[name]
    for seed in range(5):
        x, xd = random_state(seed)
        ours, autodiff = carry(psi, x, xd), carry_by_autodiff(psi, x, xd)
        for part, a, e in zip(ours._fields, ours, autodiff, strict=True):
            np.testing.assert_allclose(a, e, rtol=1e-7, atol=1e-8, err_msg=part)
        h = 1e-5
        before, after = carry(psi, x - h * xd, xd), carry(psi, x + h * xd, xd)
        rate, bend = (after.y - before.y) / (2 * h), (after.yd - before.yd) / (2 * h)
        # Deepest points are found to 6e-8 of the axis, which shows in differences of depths.
        radii = np.repeat(RADII, 10) if name == "capsules to obstacles" else np.inf
        deep = np.asarray(ours.y) + radii < 0
        np.testing.assert_allclose(ours.yd[~deep], rate[~deep], rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(ours.yd[deep], rate[deep], atol=1e-3)
        np.testing.assert_allclose(ours.J @ xd, ours.yd, atol=1e-10)
        # yd along x + t xd at constant xd changes by c alone; the capsules' nearest points slide meanwhile
        np.testing.assert_allclose(ours.c[~deep], bend[~deep], rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(ours.c[deep], bend[deep], rtol=1e-3, atol=1e-2)


def test_capsules_meet_a_grid_as_the_sphere_that_it_samples():
    axis = np.linspace(-0.6, 0.6, 49)
    values = np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1), axis=-1) - 0.2
    center = np.array([0.3, 0.0, 0.5])
    grid = World(grids=(SignedDistanceGrid(values, center - 0.6, axis[1] - axis[0]),))
    sphere = World(spheres=Spheres.of([(center, 0.2)]))
    x, xd = random_state(0)
    a, b = moving_points(1), moving_points(2)
    by_grid, by_sphere = (carry(CapsuleDistances(a, b, w, RADII), x, xd) for w in (grid, sphere))
    near = np.asarray(by_sphere.y) < 0.35
    assert near.any()
    np.testing.assert_allclose(by_grid.y[near], by_sphere.y[near], atol=2e-3)
    np.testing.assert_allclose(by_grid.yd[near], by_sphere.yd[near], atol=0.05)


def line(start, direction):
    """A point that moves along a line: x [1] -> [1, 3]."""
    return Partial(_along, jnp.asarray(start), jnp.asarray(direction))


def _along(start, direction, x):
    return (start + direction * x)[None]


def test_a_capsule_sliding_past_an_edge_has_the_second_derivative_of_the_true_distance():
    # Axis along (1, 1, 0) moving along x above the edge of a box that runs along z: the nearest points are on it.
    start, end = np.array([-1.0, 0.2, 0.3]), np.array([0.0, 1.2, -0.1])
    psi = CapsuleDistances(
        line(start, [1.0, 0, 0]), line(end, [1.0, 0.2, 0]), World(boxes=Boxes.of([(np.eye(4), (0.1, 0.1, 2))]))
    )

    def true(x):
        t = np.linspace(0, 1, 2_000_001)[:, None]
        p = (start + [x, 0, 0]) * (1 - t) + (end + [x, 0.2 * x, 0]) * t
        return np.linalg.norm(np.maximum(np.abs(p) - [0.1, 0.1, 2], 0), axis=1).min()

    at = carry(psi, jnp.zeros(1), jnp.ones(1))
    h = 1e-3
    d = [true(x) for x in (-h, 0.0, h)]
    np.testing.assert_allclose(at.y[0], d[1], atol=1e-9)
    np.testing.assert_allclose(at.yd[0], (d[2] - d[0]) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(at.c[0], (d[2] - 2 * d[1] + d[0]) / h**2, atol=1e-4)


def inside_box(p):
    q = np.abs(p) - [0.3, 0.2, 0.25]
    return np.where(q.max(-1) > 0, np.linalg.norm(np.maximum(q, 0), axis=-1), q.max(-1))


def inside_cylinder(p):
    q = np.stack([np.linalg.norm(p[..., :2], axis=-1) - 0.3, np.abs(p[..., 2]) - 0.25], axis=-1)
    return np.where(q.max(-1) > 0, np.linalg.norm(np.maximum(q, 0), axis=-1), q.max(-1))


def test_an_axis_inside_has_the_derivatives_of_the_depth_of_its_deepest_point():
    world = World(boxes=Boxes.of([(np.eye(4), (0.3, 0.2, 0.25))]), cylinders=Cylinders.of([(np.eye(4), 0.3, 0.25)]))
    for seed in range(6):
        rng = np.random.default_rng(seed)
        ends, rates = np.array([[-0.4, -0.3, -0.3], [0.4, 0.3, 0.35]]), rng.uniform(-1, 1, (2, 3))
        ends = ends + rng.uniform(-0.1, 0.1, (2, 3))

        def deepest(sdf, x, ends=ends, rates=rates):
            low, high, (a, b) = 0.0, 1.0, ends + x * rates
            for _ in range(8):  # a convex function of t: ever closer around its least sample
                t = np.linspace(low, high, 101)
                i = np.argmin(sdf(a + t[:, None] * (b - a)))
                low, high = t[max(i - 1, 0)], t[min(i + 1, 100)]
            return sdf(a + t[i] * (b - a))

        psi = CapsuleDistances(line(ends[0], rates[0]), line(ends[1], rates[1]), world)
        at, h = carry(psi, jnp.zeros(1), jnp.ones(1)), 1e-4
        for i, sdf in enumerate((inside_box, inside_cylinder)):
            d = [deepest(sdf, x) for x in (-h, 0.0, h)]
            assert d[1] < -0.05
            np.testing.assert_allclose(at.y[i], d[1], atol=1e-7)
            np.testing.assert_allclose(at.J[i, 0], (d[2] - d[0]) / (2 * h), atol=1e-5)
            np.testing.assert_allclose(at.yd[i], at.J[i, 0], rtol=1e-12)
            np.testing.assert_allclose(at.c[i], (d[2] - 2 * d[1] + d[0]) / h**2, atol=2e-3)


@pytest.mark.parametrize("radius", [0.01, 0.3, 1.0, 2.5])
def test_curvature_of_the_distance_to_a_sphere_is_that_of_the_offset_whatever_the_radii(radius):
    # Peers' Jdot is right for an obstacle of radius 1 only.
    psi = ObstacleDistances(line([3.0, 0, 4], [0.2, 1.0, -0.5]), World(spheres=Spheres.of([((0, 0, 0), radius)])), 0.4)
    at = carry(psi, jnp.zeros(1), jnp.ones(1))
    n, v = np.array([3.0, 0, 4]) / 5, np.array([0.2, 1, -0.5])
    tangential = v - n * (n @ v)
    np.testing.assert_allclose(at.y, [5 - radius - 0.4], rtol=1e-12)  # each radius is taken off once, and nothing else
    np.testing.assert_allclose(at.J, [[n @ v]], rtol=1e-12)
    np.testing.assert_allclose(at.c, [tangential @ tangential / 5], rtol=1e-12)


def test_a_batch_gives_each_of_its_states_the_same_as_alone():
    # Peers' Jdot mixes the states of a batch.
    states = [jnp.stack(part) for part in zip(*(random_state(seed) for seed in range(4)), strict=True)]
    for psi in maps(1).values():
        together = jax.jit(jax.vmap(pushforward, in_axes=(None, 0, 0)))(psi, *states)
        for i in range(4):
            alone = carry(psi, states[0][i], states[1][i])
            for a, e in zip(together, alone, strict=True):
                np.testing.assert_allclose(a[i], e, rtol=1e-9, atol=1e-9)


def test_contact_is_distance_zero_of_every_kind():
    world = World(
        Spheres.of([((0, 0, 0), 0.3)]),
        Capsules.of([((0, -1, 0), (0, 1, 0), 0.3)]),
        Boxes.of([(np.eye(4), (0.3, 1, 1))]),
        Cylinders.of([(np.eye(4), 0.3, 1)]),
        HalfSpaces.of([((1, 0, 0), 0.3)]),
    )
    touching = line([0.5, 0, 0], [1.0, 0, 0])
    to_obstacles = jax.jit(ObstacleDistances(touching, world, 0.2))
    np.testing.assert_allclose(to_obstacles(jnp.zeros(1)), np.zeros(5), atol=1e-15)
    other = line([0.9, 0.3, 0], [1.0, 0, 0])
    of_capsule = jax.jit(CapsuleDistances(touching, other, world, 0.2))
    np.testing.assert_allclose(of_capsule(jnp.zeros(1)), np.zeros(5), atol=1e-15)
    both = ControlPoints(panda(), ("panda_link1", "panda_link3"))
    to_itself = jax.jit(SelfDistances(both, ((0, 1),), (0.1, 0.216)))
    np.testing.assert_allclose(to_itself(jnp.zeros(7)), [0], atol=1e-15)


def test_pairs_are_ordered_by_point_and_then_by_obstacle():
    world = random_world(0)
    x, _ = random_state(0)
    psi = maps()["spheres to obstacles"]
    found, expected = jax.jit(lambda x: (psi(x), world.signed_distance(psi.points(x)) - RADII[:, None]))(x)
    np.testing.assert_allclose(found.reshape(5, world.size), expected, rtol=1e-12)


def test_inactive_obstacles_are_far_and_have_no_derivatives():
    x, xd = random_state(0)
    for psi in maps().values():
        if isinstance(psi, SelfDistances):
            continue
        one = {kind: replace(slots, active=np.array([True, False])) for kind, slots in slots_of(psi.world).items()}
        at = carry(replace(psi, world=replace(psi.world, **one)), x, xd)
        everyone = carry(psi, x, xd)
        off = np.tile([False, True] * 5 + [False] * len(psi.world.grids), 5)
        np.testing.assert_array_equal(at.y[off], np.full(25, FAR))
        for part, whole in zip(at, everyone, strict=True):
            np.testing.assert_array_equal(part[~off], whole[~off])
        for part in at[1:]:
            np.testing.assert_array_equal(part[off], np.zeros_like(part[off]))
        for a, e in zip(at, carry_by_autodiff(replace(psi, world=replace(psi.world, **one)), x, xd), strict=True):
            np.testing.assert_allclose(a[off], e[off], atol=1e-10)


def slots_of(world):
    return {f.name: getattr(world, f.name) for f in fields(world) if f.name != "grids"}


def test_coinciding_spheres_and_degenerate_capsules_have_finite_derivatives():
    """In the shapes of `maps`, which are compiled already."""
    x, xd = random_state(0)
    smooth, apart = maps()["capsules to obstacles"], maps()["spheres to obstacles"]
    center = smooth.points_a(x)[0]
    T = random_poses(np.random.default_rng(0), 2)
    T[0, :3, 3] = center
    there, size = jnp.asarray(np.stack([center, center])), np.full(2, 0.1)
    at_the_point = {
        "spheres": Spheres(there, size),
        "capsules": Capsules(there, there, size),
        "boxes": Boxes(T, np.full((2, 3), 0.1)),
        "cylinders": Cylinders(T, size, size),
    }
    twice = Partial(_twice, apart.points)
    for psi in (
        SelfDistances(twice, ((0, 1),), 0.1),
        replace(apart, world=replace(apart.world, **at_the_point)),
        replace(smooth, points_b=smooth.points_a, world=replace(smooth.world, **at_the_point)),
        replace(smooth, world=replace(smooth.world, **at_the_point)),
    ):
        for part in (*carry(psi, x, xd), *carry_by_autodiff(psi, x, xd)):
            assert np.isfinite(part).all()


def _twice(points, x):
    return points(x)[jnp.array([0, 0])]


def test_no_pairs_and_no_obstacles_give_no_distances():
    x, xd = random_state(0)
    for psi in (
        SelfDistances(moving_points(0), (), 0.1),
        ObstacleDistances(moving_points(0), World(), 0.1),
        CapsuleDistances(moving_points(0), moving_points(1), World(), 0.1),
    ):
        at = carry(psi, x, xd)
        assert [part.shape for part in at] == [(0,), (0,), (0, 7), (0,)]
        assert psi(x).shape == (0,)


def test_kinds_without_slots_are_no_parameters():
    none = World()
    assert jax.tree.leaves(none) == [] and none.kinds == () and none.active.shape == (0,)
    given = World(spheres=Spheres.of([((0, 0, 0), 0.3)]), boxes=Boxes.of())
    assert jax.tree.structure(given) == jax.tree.structure(World(spheres=given.spheres))
    assert given.boxes is None and len(jax.tree.leaves(given)) == 3


def test_moving_the_world_and_changing_radii_does_not_retrace_and_has_a_gradient():
    traces = []

    @jax.jit
    def nearest(psi, x, xd):
        traces.append(1)
        return jnp.min(pushforward(psi, x, xd).y)

    x, xd = random_state(0)
    psi = maps()["capsules to obstacles"]
    for seed in range(3):
        nearest(replace(psi, world=replace(random_world(seed), grids=()), radii=RADII * seed), x, xd)
    assert len(traces) == 1
    center = jnp.asarray([0.5, 0.0, 0.5])

    def distance(center):
        return ObstacleDistances(moving_points(0, 1), World(spheres=Spheres(center[None], [0.1])))(x)[0]

    offset = center - moving_points(0, 1)(x)[0]
    np.testing.assert_allclose(jax.grad(distance)(center), offset / jnp.linalg.norm(offset), rtol=1e-9)


def test_single_precision_stays_single():
    x, xd = (part.astype(jnp.float32) for part in random_state(0))
    for psi in maps().values():
        ours, exact = carry(psi, x, xd), carry(psi, *random_state(0))
        free = np.asarray(exact.y) > 0
        for a, e in zip(ours, exact, strict=True):
            assert a.dtype == jnp.float32
            np.testing.assert_allclose(a[free], e[free], rtol=1e-3, atol=1e-3 * max(1, np.abs(e[free]).max(initial=0)))


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda p: ObstacleDistances(p, World(), -0.1), ConfigurationError, "radii of ObstacleDistances is -0.1"),
        (lambda p: CapsuleDistances(p, p, World(), [0.1, -2]), ConfigurationError, r"radii\[1\].*is -2"),
        (lambda p: SelfDistances(p, ((1, 1),)), ConfigurationError, r"\(1, 1\), a point and itself"),
        (lambda p: SelfDistances(p, ((1, 2, 3),)), ShapeError, r"\(1, 2, 3\), expected pairs"),
        (lambda p: SelfDistances(p, ((0, 9),))(jnp.zeros(7)), ShapeError, "point 9, but there are 5"),
        (
            lambda p: ObstacleDistances(p, World(), [0.1, 0.2])(jnp.zeros(7)),
            ShapeError,
            r"radii has shape \(2,\).*\(5,\)",
        ),
        (
            lambda p: CapsuleDistances(p, moving_points(0, 2), World())(jnp.zeros(7)),
            ShapeError,
            "points_a and points_b",
        ),
    ],
)
def test_what_does_not_fit_is_refused(build, error, message):
    with pytest.raises(error, match=message):
        build(moving_points(0))
