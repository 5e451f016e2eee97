"""A sampled signed distance field, against the sphere that it was sampled from."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp.world import SignedDistanceGrid, World

from .conftest import random_poses, sphere_grid

pytestmark = pytest.mark.usefixtures("x64")
CENTER, RADIUS = np.array([0.1, -0.2, 0.3]), 0.25


def world(n, **options):
    return World(grids=(sphere_grid(CENTER, RADIUS, n=n, **options),))


def points(count=200):
    """Points of the grid's inside, away from the centre, where the distance has a kink."""
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return jnp.asarray(CENTER + rng.uniform(0.15, 0.45, (count, 1)) * direction)


@pytest.mark.parametrize(("smooth", "order"), [(True, 2.7), (False, 1.8)])
def test_interpolation_converges_to_the_sphere_at_its_order(smooth, order):
    exact = np.linalg.norm(points() - CENTER, axis=1) - RADIUS
    errors = [np.abs(world(n, smooth=smooth).signed_distance(points())[:, 0] - exact).max() for n in (21, 41)]
    assert errors[1] < (1e-4 if smooth else 1e-3)
    assert np.log2(errors[0] / errors[1]) > order


def test_gradient_and_curvature_are_those_of_the_sphere():
    field = world(41)
    for p in points(10):
        offset = p - CENTER
        r = jnp.linalg.norm(offset)
        np.testing.assert_allclose(jax.jacfwd(field.signed_distance)(p)[0], offset / r, atol=0.01)
        H = jax.hessian(lambda p: field.signed_distance(p)[0])(p)
        np.testing.assert_allclose(
            H, (jnp.eye(3) - jnp.outer(offset, offset) / r**2) / r, atol=1.0
        )  # of 1 / r = 2 to 7


def test_the_smooth_gradient_is_continuous_across_cells_and_the_linear_one_is_not():
    spacing = 1.0 / 20
    p = jnp.asarray(CENTER + np.array([3 * spacing, 0.33 * spacing, 1.21 * spacing]))
    for smooth in (True, False):
        slope = jax.jacfwd(world(21, smooth=smooth).signed_distance)
        jump = np.abs(slope(p + 1e-9) - slope(p - 1e-9)).max()
        assert (jump < 1e-6) == smooth


def test_samples_are_met_and_the_border_continues_outwards():
    field = world(11)
    grid = field.grids[0]
    at = np.asarray(grid.origin) + 0.1 * np.array([[0, 3, 10], [5, 5, 5], [10, 10, 10], [1, 0, 9]])
    expected = [grid.values[tuple(i)] for i in np.rint((at - grid.origin) / 0.1).astype(int)]
    np.testing.assert_allclose(field.signed_distance(at)[:, 0], expected, atol=1e-12)
    border = jnp.asarray(grid.origin + np.array([1.0, 0.4, 0.6]))
    beyond = border + jnp.asarray([0.3, 0, 0])
    np.testing.assert_allclose(field.signed_distance(beyond), field.signed_distance(border) + 0.3, atol=1e-12)
    for p in (border, beyond, jnp.asarray(grid.origin), jnp.asarray(grid.origin) - 0.2):
        assert np.isfinite(jax.jacfwd(field.signed_distance)(p)).all()
        assert np.isfinite(jax.jacfwd(jax.jacfwd(field.signed_distance))(p)).all()


def test_a_grid_turns_with_its_pose():
    T = random_poses(np.random.default_rng(4), 1)[0]
    still = world(21)
    turned = world(21, T_world_grid=T)
    p = np.asarray(points(20))
    there = p @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(turned.signed_distance(there), still.signed_distance(p), atol=1e-12)


def test_a_capsule_misses_no_more_than_a_32nd_of_its_length_between_samples():
    axis = np.linspace(-0.5, 0.5, 101)
    at = np.stack(np.meshgrid(axis, np.linspace(-0.1, 0.1, 21), np.linspace(-0.1, 0.1, 21), indexing="ij"), axis=-1)
    thin = np.array([[-0.28, 0.03, 0], [0.0, 0.05, 0.02], [0.28, -0.035, 0]])  # needles: many dips along the axis
    values = np.linalg.norm(at[..., None, :2] - thin[:, :2], axis=-1).min(axis=-1) - 0.005
    grid = SignedDistanceGrid(values, (-0.5, -0.1, -0.1), 0.01)
    nearest = jax.jit(grid.nearest_on_segment)
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(50):
        a, b = rng.uniform([-0.5, -0.1, -0.1], [0.5, 0.1, 0.1], (2, 3))
        t = float(nearest(tuple(jnp.asarray(a)), tuple(jnp.asarray(b))))
        points = a + np.array([t, *np.linspace(0, 1, 2001)])[:, None] * (b - a)
        found, *all_along = np.asarray(World(grids=(grid,)).signed_distance(points))[:, 0]
        errors.append((found - min(all_along)) / np.linalg.norm(b - a))
    assert max(errors) <= 1 / 32 and np.median(errors) < 1e-6
