"""Signed distances of meshes: against solids whose distances are known, with holes, cut in pieces and inside out."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, ShapeError
from jaxrmp.world import Boxes, World, grid_of_mesh

FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6]])
FACES = np.concatenate([FACES, [[0, 6, 4], [1, 5, 7], [1, 7, 3]]])
HALF = np.array([0.1, 0.04, 0.02])
CORNERS = np.stack(np.meshgrid(*[[-1, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3) * HALF


def distances(grid, p):
    return np.asarray(World(grids=(grid,)).signed_distance(jnp.asarray(p, jnp.float32)))[:, 0]


@pytest.mark.parametrize("what", ["closed", "inside out", "with a hole"])
def test_of_a_box_they_are_those_of_the_box(what):
    faces = {"closed": FACES, "inside out": FACES[:, ::-1], "with a hole": FACES[:-1]}[what]
    grid = grid_of_mesh(CORNERS, faces, 0.005)
    p = np.random.default_rng(0).uniform(-1.1, 1.1, (3000, 3)) * HALF
    if what == "with a hole":
        p = p[p[:, 2] < 0.01]
    box = World(boxes=Boxes(np.eye(4)[None], HALF[None]))
    expected = np.asarray(box.signed_distance(jnp.asarray(p, jnp.float32)))[:, 0]
    error = np.abs(distances(grid, p) - expected)
    near = np.abs(expected) < 0.004
    assert near.sum() > 500
    assert np.quantile(error[near], 0.7) < 1e-5  # but at edges, which lines between points round off
    assert error[near].max() < 0.004
    assert (np.sign(distances(grid, p)) == np.sign(expected))[np.abs(expected) > 1e-3].all()


def test_of_a_ball_they_are_within_a_tenth_of_a_millimetre_at_its_surface():
    u, v = np.meshgrid(np.linspace(0, np.pi, 61), np.linspace(0, 2 * np.pi, 120, endpoint=False), indexing="ij")
    ball = 0.06 * np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1)
    k = np.arange(61 * 120).reshape(61, 120)
    a, b, c, d = k[:-1], k[1:], np.roll(k, -1, 1)[1:], np.roll(k, -1, 1)[:-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    grid = grid_of_mesh(ball.reshape(-1, 3), faces, 0.004)
    way = np.random.default_rng(1).normal(size=(2000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    away = np.random.default_rng(2).uniform(-0.003, 0.003, 2000)
    np.testing.assert_allclose(distances(grid, (0.06 + away)[:, None] * way), away, atol=1.5e-4)
    assert distances(grid, [[0, 0, 0.2]])[0] == pytest.approx(0.14, abs=0.004)


def test_what_is_no_mesh_is_refused():
    with pytest.raises(ShapeError, match="faces"):
        grid_of_mesh(CORNERS, np.zeros((0, 3), int))
    with pytest.raises(ConfigurationError, match="not there"):
        grid_of_mesh(CORNERS, FACES + 1)
    with pytest.raises(ConfigurationError, match="spacing"):
        grid_of_mesh(CORNERS, FACES, 0.0)
    with pytest.raises(ConfigurationError, match="farther apart"):
        grid_of_mesh(1e3 * CORNERS, FACES, 0.004)
