"""Signed distances of a point to one obstacle: outside, inside, on the surface, at their singular points."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, RigidTransformError, ShapeError
from jaxrmp.world import FAR, Boxes, Capsules, Cylinders, HalfSpaces, SignedDistanceGrid, Spheres, World

from .conftest import random_kinds, random_poses, random_world, sphere_grid

pytestmark = pytest.mark.usefixtures("x64")


def surface_points(name, kind, rng, count=40000):
    """Points on the surface of the first obstacle of a kind, drawn densely, without the formula under test."""
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    if name == "spheres":
        return kind.center[0] + kind.radius[0] * direction
    if name == "capsules":
        axis = kind.end[0] - kind.start[0]
        along = rng.uniform(0, 1, (count, 1)) * axis
        side = np.cross(direction, axis)
        side *= kind.radius[0] / np.linalg.norm(side, axis=1, keepdims=True)
        caps = kind.radius[0] * direction
        caps += np.where(caps @ axis > 0, 1, 0)[:, None] * axis
        return kind.start[0] + np.concatenate([along + side, caps])
    if name == "boxes":
        local = rng.uniform(-1, 1, (count, 3))
        face = rng.integers(0, 3, count)
        local[np.arange(count), face] = np.sign(local[np.arange(count), face])
        T, local = kind.T_world_box[0], local * kind.half_extents[0]
    else:
        T, r, half = kind.T_world_cylinder[0], kind.radius[0], kind.half_length[0]
        angle, z = rng.uniform(0, 2 * np.pi, count), rng.uniform(-half, half, count)
        ends = rng.random(count) < 0.5
        rho = np.where(ends, r * np.sqrt(rng.random(count)), r)
        local = np.stack([rho * np.cos(angle), rho * np.sin(angle), np.where(ends, np.sign(z) * half, z)], axis=1)
    return T[:3, 3] + local @ T[:3, :3].T


@pytest.mark.parametrize("name", ["spheres", "capsules", "boxes", "cylinders"])
def test_inside_and_outside_the_distance_is_that_to_the_nearest_surface_point(name):
    rng = np.random.default_rng(1)
    kind = random_kinds(rng, 1)[name]
    surface = surface_points(name, kind, rng)
    p = surface[:60] + rng.normal(size=(60, 3)) * 0.08
    ours = np.asarray(World(**{name: kind}).signed_distance(p))[:, 0]
    brute = np.linalg.norm(p[:, None] - surface, axis=-1).min(axis=1)
    assert (ours < 0).sum() > 5 and (ours > 0).sum() > 5
    assert (np.abs(ours) <= brute + 1e-12).all()  # samples can only be farther than the nearest point
    np.testing.assert_allclose(np.abs(ours), brute, atol=0.01)
    middle = {"spheres": "center", "capsules": "start"}.get(name)
    inside = (
        getattr(kind, middle)[0] if middle else getattr(kind, f"T_world_{name[:-1].replace('boxe', 'box')}")[0, :3, 3]
    )
    assert World(**{name: kind}).signed_distance(jnp.asarray(inside))[0] < 0


def test_a_half_space_is_free_where_the_normal_points():
    world = World(half_spaces=HalfSpaces.of([((0, 0, 2.0), 1.0)]))  # 2 z >= 1
    np.testing.assert_allclose(world.signed_distance(jnp.asarray([[5.0, 7, 1.5], [0, 0, 0]])), [[1], [-0.5]])


def test_gradients_have_unit_length_away_from_singular_points_and_agree_with_finite_differences():
    world = random_world(0)
    rng = np.random.default_rng(2)
    slope, distance = jax.jit(jax.jacfwd(world.signed_distance)), jax.jit(world.signed_distance)
    for p in rng.uniform(-1, 1, (20, 3)):
        J = slope(p)
        h = 1e-6 * np.eye(3)
        numeric = (distance(p + h) - distance(p - h)) / 2e-6
        np.testing.assert_allclose(J.T, numeric, atol=1e-4)
        np.testing.assert_allclose(np.linalg.norm(J[:-1], axis=1), 1, atol=1e-9)


def singular_points():
    T = random_poses(np.random.default_rng(3), 1)
    R, t = T[0, :3, :3], T[0, :3, 3]
    box, cylinder = Boxes(T, [[0.1, 0.2, 0.3]]), Cylinders(T, [0.2], [0.3])
    cube = Boxes(T, [[0.1, 0.1, 0.1]])
    square = Cylinders(T, [0.2], [0.2])
    cases = {
        "sphere, centre": (World(spheres=Spheres.of([(t, 0.3)])), [0, 0, 0]),
        "sphere of no radius, centre": (World(spheres=Spheres.of([(t, 0.0)])), [0, 0, 0]),
        "capsule, axis": (World(capsules=Capsules.of([(t - R[:, 2], t + R[:, 2], 0.1)])), [0, 0, 0.5]),
        "capsule, end of axis": (World(capsules=Capsules.of([(t - R[:, 2], t + R[:, 2], 0.1)])), [0, 0, 1]),
        "capsule of no length": (World(capsules=Capsules.of([(t, t, 0.1)])), [0, 0, 0]),
        "box, centre": (World(boxes=box), [0, 0, 0]),
        "cube, centre": (World(boxes=cube), [0, 0, 0]),
        "box, face": (World(boxes=box), [0.1, 0.02, 0.03]),
        "box, edge": (World(boxes=box), [0.1, 0.2, 0.03]),
        "box, corner": (World(boxes=box), [0.1, 0.2, 0.3]),
        "box, above an edge": (World(boxes=box), [0.1, 0.25, 0.0]),
        "cylinder, centre": (World(cylinders=cylinder), [0, 0, 0]),
        "cylinder, axis at the end": (World(cylinders=cylinder), [0, 0, 0.3]),
        "cylinder, rim": (World(cylinders=cylinder), [0.2, 0, 0.3]),
        "cylinder as high as wide, centre": (World(cylinders=square), [0, 0, 0]),
        "box of no size": (World(boxes=Boxes(T, [[0.0, 0, 0]])), [0, 0, 0]),
        "grid, border": (World(grids=(sphere_grid(t, 0.2),)), [0, 0, 0]),
    }
    return {name: (world, t + R @ np.array(p)) for name, (world, p) in cases.items()}


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_derivatives_are_finite_at_singular_points(dtype):
    for name, (world, p) in singular_points().items():
        p = jnp.asarray(p, dtype)
        for point in (p, p + 1e-13, p - 1e-9, p + 1e-6):
            J, H = slope_and_bend(world, point)
            assert J.dtype == dtype
            assert np.isfinite(J).all() and np.isfinite(H).all(), name
            assert np.linalg.norm(J) <= 1 + 1e-5, name
            if "box" in name or "cube" in name:
                np.testing.assert_allclose(np.linalg.norm(J), 1, atol=1e-5, err_msg=name)
        by_world = slope_by_world(as_arrays(world, dtype), p)
        for leaf in jax.tree.leaves(by_world):
            assert leaf.dtype == jax.dtypes.float0 or np.isfinite(leaf).all(), name


@jax.jit
def slope_and_bend(world, p):
    return jax.jacfwd(world.signed_distance)(p), jax.jacfwd(jax.jacfwd(world.signed_distance))(p)


@jax.jit
def slope_by_world(world, p):
    return jax.grad(lambda world: jnp.sum(world.signed_distance(p)), allow_int=True)(world)


def as_arrays(world, dtype):
    return jax.tree.map(lambda a: jnp.asarray(a, dtype if np.asarray(a).dtype == float else None), world)


def test_inactive_slots_are_far_and_do_not_pull():
    sphere = Spheres.of([((0, 0, 0), 0.1)], capacity=3)
    world = World(spheres=sphere, boxes=Boxes.of(capacity=2), grids=(sphere_grid((0, 0, 0), 0.2, n=5, active=False),))
    assert world.size == 6
    p = jnp.asarray([0.3, 0, 0])
    distance, J = jax.jit(lambda p: (world.signed_distance(p), jax.jacfwd(world.signed_distance)(p)))(p)
    np.testing.assert_allclose(distance, [0.2, *[FAR] * 5])
    np.testing.assert_array_equal(J[1:], np.zeros((5, 3)))
    np.testing.assert_array_equal(world.active, [True, *[False] * 5])


def test_an_empty_world_has_no_distances():
    assert World().size == 0
    assert World().signed_distance(jnp.zeros((4, 3))).shape == (4, 0)


def test_a_slot_can_be_filled_and_emptied():
    spheres = Spheres.of(capacity=2).set(1, center=(1.0, 0, 0), radius=0.5)
    np.testing.assert_allclose(World(spheres=spheres).signed_distance(jnp.zeros(3)), [FAR, 0.5])
    np.testing.assert_array_equal(spheres.set(1, active=False).active, [False, False])
    with pytest.raises(ConfigurationError, match=r"no field \['centre'\].*'center'"):
        spheres.set(0, centre=(0, 0, 0))
    with pytest.raises(ConfigurationError, match=r"radius\[0\] of Spheres is -1"):
        spheres.set(0, radius=-1.0)


REFLECTION = np.diag([1.0, 1, -1, 1])


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (
            lambda: Spheres.of([((0, 0, 0), 0.1)] * 5, capacity=4),
            ConfigurationError,
            "5 obstacles.*capacity=4.*at least 5",
        ),
        (
            lambda: Boxes.of([(np.eye(4), (1, 1, 1))] * 2, capacity=1),
            ConfigurationError,
            "2 obstacles.*capacity=1 of Boxes",
        ),
        (lambda: Spheres.of([((0, 0, 0), -0.1)]), ConfigurationError, r"radius\[0\] of Spheres is -0.1"),
        (lambda: Spheres.of([((0, 0, 0),)]), ConfigurationError, "obstacle 0 of Spheres has 1 entries, expected 2"),
        (lambda: Capsules.of([((0, 0, 0), (1, 0, 0), -1)]), ConfigurationError, r"radius\[0\] of Capsules is -1"),
        (lambda: Boxes.of([(np.eye(4), (1, -2, 1))]), ConfigurationError, r"half_extents\[0, 1\] of Boxes is -2"),
        (lambda: Boxes.of([(2 * np.eye(4), (1, 1, 1))]), RigidTransformError, "T_world_box"),
        (lambda: Boxes.of([(REFLECTION, (1, 1, 1))]), RigidTransformError, "reflection"),
        (lambda: Cylinders.of([(REFLECTION, 1, 1)]), RigidTransformError, "T_world_cylinder.*reflection"),
        (lambda: Cylinders.of([(np.eye(4), 1, -1)]), ConfigurationError, r"half_length\[0\] of Cylinders is -1"),
        (lambda: HalfSpaces.of([((0, 0, 0), 1)]), ConfigurationError, "normal of HalfSpaces is zero for obstacle 0"),
        (
            lambda: Spheres(np.zeros((2, 3)), np.zeros(3)),
            ShapeError,
            r"radius of Spheres has shape \(3,\), expected \(2\)",
        ),
        (lambda: Spheres(np.zeros((1, 3)), [1.0], [1.0]), ShapeError, "active of Spheres.*float64.*bool"),
        (lambda: SignedDistanceGrid(np.zeros((3, 3))), ShapeError, "values has shape"),
        (lambda: SignedDistanceGrid(np.zeros((3, 3, 3)), spacing=0.0), ConfigurationError, "spacing.*0.0.*positive"),
        (lambda: World(spheres=Boxes.of()), ConfigurationError, "spheres is a Boxes, expected Spheres"),
        (lambda: World(grids=(Boxes.of(),)), ConfigurationError, "grids holds a Boxes"),
        (lambda: World().signed_distance(np.zeros(2)), ShapeError, r"p has shape \(2,\)"),
    ],
)
def test_what_is_no_obstacle_is_refused_with_what_was_received(build, error, message):
    with pytest.raises(error, match=message):
        build()


def test_nothing_retraces_when_obstacles_move_come_and_go():
    traces = []

    @jax.jit
    def distances(world, p):
        traces.append(1)
        return world.signed_distance(p)

    p = jnp.asarray([0.1, 0.2, 0.3])
    T = random_poses(np.random.default_rng(0), 6)
    for count in (2, 0, 4):
        boxes = Boxes.of([(T[i], (0.1, 0.1, 0.1)) for i in range(count)], capacity=4)
        for grid_active in (True, False):
            grid = sphere_grid((0.1 * count, 0, 0), 0.2, n=5, active=grid_active)
            found = distances(World(boxes=boxes, spheres=Spheres.of([((count, 0, 0), 0.1)], 2), grids=(grid,)), p)
            assert (np.asarray(found) < FAR).sum() == 1 + count + grid_active
    world = World(boxes=boxes, spheres=Spheres.of([((0, 0, 0), 0.1)], 2), grids=(grid,))
    moved = dataclasses.replace(world, boxes=boxes.set(1, T_world_box=T[5], active=False))
    assert (np.asarray(distances(moved, p)) < FAR).sum() == 4
    assert len(traces) == 1
