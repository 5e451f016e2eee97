"""What a camera did not see is no obstacle: rows that are not finite are ignored and counted."""

import warnings
from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, acceleration, pullback
from jaxrmp.leaves import Attractor, CollisionAvoidance
from jaxrmp.world import FAR, CapsuleDistances, HalfSpaces, ObstacleDistances, Spheres, World
from jaxrmp.xla import in_lanes, machinery

from .conftest import moving_points, random_kinds, random_state, random_world, sphere_grid

KINDS = random_kinds(np.random.default_rng(0), 3)
POINTS, ENDS = moving_points(0, 2), moving_points(1, 2)
X, XD = (np.asarray(a, np.float32) for a in random_state(0))
BROKEN = [(name, f.name) for name, kind in KINDS.items() for f in fields(kind) if f.name != "active"]
BAD = pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, np.float32(3.4e38)], ids=str)


def broken(kind, field, value):
    """The second of three obstacles with one number of one field replaced; and without that obstacle."""
    row = np.array(getattr(kind, field), np.float32)
    row[(1, *(0,) * (row.ndim - 1))] = value
    without = {f.name: np.asarray(getattr(kind, f.name))[[0, 2]] for f in fields(kind)}
    return {field: row}, type(kind)(**without)


def motion(world, goal=0.3, distances=ObstacleDistances):
    ends = (POINTS,) if distances is ObstacleDistances else (POINTS, ENDS)
    near = pullback(distances(*ends, world, 0.01), CollisionAvoidance(reach=3.0, frequency=5.0))
    return acceleration(near + Attractor(jnp.full(7, goal, X.dtype)), X, XD)


def made(name, row):
    return World(**{name: replace(KINDS[name], **row)})


@BAD
@pytest.mark.parametrize(("name", "field"), BROKEN, ids=str)
def test_a_row_that_is_not_finite_is_nowhere(name, field, bad):
    row, others = broken(KINDS[name], field, bad)
    with pytest.warns(UserWarning, match=f"some rows of {type(others).__name__} are not finite.*World.ignored"):
        eager = made(name, row)
    compiled = jax.jit(
        lambda row: (lambda world: (world.ignored, world.active, world.signed_distance(X[:3])))(made(name, row))
    )
    expected = World(**{name: others}).signed_distance(X[:3])
    for ignored, active, distance in (compiled(row), (eager.ignored, eager.active, eager.signed_distance(X[:3]))):
        assert ignored == 1
        np.testing.assert_array_equal(active, [True, False, True])
        np.testing.assert_allclose(distance, [expected[0], FAR, expected[1]], rtol=1e-5)


@pytest.mark.parametrize(
    ("places", "distances"),
    [
        ({"spheres": "center", "boxes": "T_world_box", "half_spaces": "normal"}, ObstacleDistances),
        ({"capsules": "radius"}, CapsuleDistances),
    ],
    ids=["ObstacleDistances", "CapsuleDistances"],
)
def test_the_joints_and_gradients_never_get_it(places, distances):
    broken_ones = {name: broken(KINDS[name], field, np.nan) for name, field in places.items()}
    rows = {name: row for name, (row, _) in broken_ones.items()}
    others = World(**{name: without for name, (_, without) in broken_ones.items()})

    def of_goal(goal, rows):
        # One number moves all rows, so that a slope of the one that is ignored would spoil it.
        moved = jax.tree.map(lambda a: a + 0 * goal, rows)
        world = World(**{name: replace(KINDS[name], **row) for name, row in moved.items()})
        return motion(world, goal, distances)

    found = jax.jit(lambda goal, rows: (of_goal(goal, rows), jax.jacrev(of_goal)(goal, rows)))(0.3, rows)
    expected = jax.jit(lambda goal: jax.jvp(lambda g: motion(others, g, distances), (goal,), (jnp.ones_like(goal),)))(
        jnp.float32(0.3)
    )
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-4 * np.abs(b).max())


def test_batches_by_c_give_the_same():
    row, _ = broken(KINDS["boxes"], "T_world_box", np.nan)
    rows = jax.tree.map(lambda a: np.stack([np.nan_to_num(a), a] * 4), row)
    many = jax.jit(jax.vmap(in_lanes(lambda row: motion(made("boxes", row)))))
    found = many(rows)
    with machinery(False):
        np.testing.assert_allclose(found, many(rows), rtol=1e-3, atol=1e-4)
    assert np.isfinite(found).all()


def test_a_value_that_is_changed_under_the_hood_is_seen_too():
    world = random_world(0)
    world = jax.tree.map(lambda a: np.full_like(a, np.nan) if a.dtype == float else a, world)
    assert world.ignored == world.size and not world.active.any()
    assert (world.signed_distance(X[:3]) == FAR).all()


def test_slots_that_are_empty_are_not_counted_and_what_is_finite_is_not_warned_of():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        world = World(spheres=Spheres.of([((0, 0, 0), 0.1)], capacity=4))
        hidden = Spheres(np.full((2, 3), np.nan), np.ones(2), np.zeros(2, bool))
    assert world.ignored == 0 and World(spheres=hidden).ignored == 0
    with pytest.warns(UserWarning, match="rows of Spheres"):
        assert World(spheres=world.spheres.set(1, center=(np.inf, 0, 0), radius=1.0)).ignored == 1


def test_sizes_that_are_negative_are_ignored_where_they_cannot_be_refused():
    count = jax.jit(lambda radius: World(spheres=Spheres(np.zeros((2, 3)), radius)).ignored)
    assert count(np.array([-0.1, 0.1])) == 1
    distance = jax.jit(lambda n: World(half_spaces=HalfSpaces(n, np.ones(2))).signed_distance(jnp.zeros(3)))
    np.testing.assert_allclose(distance(np.array([[0, 0, 0], [0, 0, 1.0]])), [FAR, -1])


def test_holes_in_a_grid_are_far_away_without_slope():
    grid = sphere_grid((0.0, 0, 0), 0.2)
    values = np.array(grid.values)
    values[3, 3, 3] = np.nan
    with pytest.warns(UserWarning, match="numbers of a SignedDistanceGrid"):
        world = World(grids=(replace(grid, values=values),))
    assert world.ignored == 1 and world.active.all()
    hole, elsewhere = np.full(3, -0.35), np.array([0.3, 0.1, 0.2])
    np.testing.assert_array_equal(jax.jacrev(world.signed_distance)(hole), np.zeros((1, 3)))
    assert world.signed_distance(hole) == FAR
    np.testing.assert_array_equal(world.signed_distance(elsewhere), World(grids=(grid,)).signed_distance(elsewhere))
    lost = jax.jit(lambda T: World(grids=(replace(grid, T_world_grid=T),)).signed_distance(elsewhere))
    assert lost(np.full((4, 4), np.nan)) == FAR


@pytest.mark.parametrize("name", KINDS)
def test_padding_that_is_not_finite_leaves_gradients_finite(name):
    kind = KINDS[name]
    padded = {f.name: np.array(getattr(kind, f.name), float) for f in fields(kind) if f.name != "active"}
    for row in padded.values():
        row[1] = np.nan
    world = World(**{name: type(kind)(**padded, active=np.array([True, False, True]))})
    assert world.ignored == 0
    assert np.isfinite(jax.grad(lambda p: world.signed_distance(p).sum())(jnp.ones(3))).all()


@pytest.mark.parametrize("index", [4, -1, np.int64(4), np.int8(-1), np.uint8(200), np.array(4), jnp.array(7)], ids=repr)
def test_an_index_beyond_the_slots_is_refused_whatever_its_type(index):
    spheres = Spheres.of([((0.5, 0, 0.4), 0.1)], capacity=4)
    with pytest.raises(ConfigurationError, match="is beyond the 4 slots of Spheres, 0 to 3"):
        spheres.set(index, radius=0.2)
    found = jax.jit(lambda index: spheres.set(index, center=np.ones(3), radius=0.2))(index)
    jax.tree.map(np.testing.assert_allclose, found, jax.tree.map(jnp.asarray, spheres))


@pytest.mark.parametrize(
    "index", [True, np.True_, 1.0, "1", None, [1], np.arange(2), slice(2), np.ones(1, int)], ids=repr
)
def test_what_is_no_index_is_refused(index):
    with pytest.raises(ConfigurationError, match="is no integer: give the number of one of the 4 slots of Spheres"):
        Spheres.of(capacity=4).set(index, radius=0.2)


@pytest.mark.parametrize("index", [3, np.int64(3), np.uint8(3), np.array(3), jnp.array(3)], ids=repr)
def test_an_index_of_any_integer_type_serves(index):
    for set_ in (lambda s, i: s.set(i, radius=0.2), jax.jit(lambda s, i: s.set(i, radius=0.2))):
        assert set_(Spheres.of(capacity=4), index).active.tolist() == [False, False, False, True]
