"""Tracking in rendered depth: from a rough guess, through noise, occlusion and a move behind it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, RigidTransformError, ShapeError
from jaxrmp._rotations import pose, rotation_of_vector
from jaxrmp.kinematics import panda
from jaxrmp.perception import (
    KINECT,
    Camera,
    ObjectTrackerSettings,
    depth_renderer,
    measured_depth,
    robot_spheres,
    start_estimate,
    track,
)
from jaxrmp.perception._rays import rays_at
from jaxrmp.world import panda_spheres

from .conftest import T_WORLD_OBJECT, camera, model_and_data, put, thing

SETTINGS = ObjectTrackerSettings()
MOVED = pose(T_WORLD_OBJECT[:3, 3] + [0.05, 0.04, 0.0], rotation_of_vector(np.array([0.0, 0.0, 0.15])))


@pytest.fixture(scope="module")
def watched():
    """A model, its tracker's step, and 36 images: hidden from 15 to 22, and moved meanwhile."""
    m, data = model_and_data()
    model, eye, rng, images, truth = thing(m), camera(), np.random.default_rng(0), [], []
    with depth_renderer(m, eye.width, eye.height) as render:
        for k in range(36):
            T = T_WORLD_OBJECT if k < 18 else MOVED
            hinge, slide = 0.5 + 0.3 * np.sin(0.1 * k), 0.1 + 0.05 * np.cos(0.15 * k)
            put(m, data, hinge, slide, T)
            depth = measured_depth(KINECT, render(data, eye), rng)
            images.append(np.where((15 <= k < 22) & (depth > 0), 0.5, depth).astype(np.float32))
            truth.append((T, np.array([hinge, slide])))
    step = jax.jit(lambda estimate, depth: track(model, SETTINGS, estimate, depth, eye))
    return model, step, images, truth


@pytest.fixture(scope="module")
def followed(watched):
    model, step, images, truth = watched
    turn = rotation_of_vector(np.radians(15) * np.array([0.0, 0.6, 0.8]))
    guess = pose(T_WORLD_OBJECT[:3, 3] + 0.05 * np.array([0.6, -0.8, 0.0]), turn @ T_WORLD_OBJECT[:3, :3])
    estimates = [start_estimate(model, SETTINGS, guess, truth[0][1] + [0.25, -0.04])]
    for image in images:
        estimates.append(step(estimates[-1], image))
    return estimates[1:]


def errors(estimate, truth):
    T, q = truth
    found = np.asarray(estimate.T_world_object)
    turn = T[:3, :3].T @ found[:3, :3]
    angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
    return np.linalg.norm(found[:3, 3] - T[:3, 3]), angle, *np.abs(np.asarray(estimate.q) - q)


def test_from_a_rough_guess_the_object_is_found_and_followed(followed, watched):
    truth = watched[3]
    found = np.array([errors(e, t) for e, t in zip(followed[10:15], truth[10:15], strict=True)])
    assert not any(e.lost for e in followed[10:15])
    position, turn, hinge, slide = np.sqrt((found**2).mean(0))
    assert position < 0.003 and turn < 0.01 and hinge < np.radians(0.5) and slide < 0.002
    assert all(e.rms < 0.01 and (e.fits > 0.1).all() for e in followed[10:15])


def test_a_hidden_object_is_said_to_be_lost_and_stays_where_it_was(followed):
    assert all(e.lost for e in followed[15:22])
    for e in followed[15:22]:
        np.testing.assert_array_equal(e.T_world_object, followed[14].T_world_object)
        assert (jnp.diagonal(e.covariance)[:8] > 100 * jnp.diagonal(followed[14].covariance)[:8]).all()


def test_it_is_found_again_where_it_was_moved_to_within_half_a_second(followed, watched):
    truth = watched[3]
    for e, t in zip(followed[34:], truth[34:], strict=True):
        position, turn, hinge, slide = errors(e, t)
        assert not e.lost
        assert position < 0.004 and turn < 0.015 and hinge < np.radians(0.7) and slide < 0.003


def test_half_hidden_close_above_a_floor_it_is_found_within_a_few_images():
    m, data = model_and_data()
    T, q = T_WORLD_OBJECT.copy(), np.array([0.5, 0.1])
    T[2, 3] = 0.24  # the floor, 4 cm below, fits the cabinet's lower edges as well as these do
    eye = Camera.looking([-0.3, -1.1, 0.94], T[:3, 3] + [0.0, 0.05, 0.0], 320, 240)
    model, noise, images = thing(m), np.random.default_rng(0), []
    put(m, data, *q, T)
    with depth_renderer(m, eye.width, eye.height) as render:
        for _ in range(7):
            image = measured_depth(KINECT, render(data, eye), noise)
            image[:, 190:] = 0
            images.append(image)
    step = jax.jit(lambda estimate, depth: track(model, SETTINGS, estimate, depth, eye))
    for seed in (0, 7):
        rng = np.random.default_rng(seed)
        way, axis = rng.normal(size=(2, 3))
        turn = rotation_of_vector(np.radians(15) * axis / np.linalg.norm(axis))
        guess = pose(T[:3, 3] + 0.05 * way / np.linalg.norm(way), turn @ T[:3, :3])
        estimate = start_estimate(model, SETTINGS, guess, q + rng.choice([-1, 1], 2) * [0.25, 0.05])
        for image in images:
            estimate = step(estimate, image)
        position, turn, hinge, _ = errors(estimate, (T, q))
        assert not estimate.lost
        assert position < 0.02 and turn < 0.05 and hinge < 0.05


def test_a_board_before_the_camera_for_two_seconds_does_not_lead_the_search_away(followed, watched):
    _, step, images, _ = watched
    estimate = followed[14]
    for _ in range(60):
        estimate = step(estimate, np.full_like(images[0], 0.5))
    assert estimate.lost
    np.testing.assert_array_equal(estimate.sure.t, followed[14].sure.t)
    assert np.linalg.norm(estimate.guess.t - estimate.sure.t) < 0.2


def test_covariances_are_symmetric_and_positive_and_rotations_stay_rotations(followed):
    for e in followed:
        P, R = np.asarray(e.covariance, float), np.asarray(e.T_world_object[:3, :3], float)
        scale = np.sqrt(np.diag(P))
        np.testing.assert_allclose(P, P.T, rtol=1e-5)
        assert np.linalg.eigvalsh(P / scale / scale[:, None]).min() > 0
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-5)


def test_mapped_over_cameras_it_does_the_same(followed, watched):
    _, step, images, _ = watched
    two = jax.tree.map(lambda a, b: jnp.stack([a, b]), followed[11], followed[13])
    both = jax.vmap(step)(two, jnp.stack([images[12], images[14]]))
    assert not both.lost.any()
    for k, alone in enumerate((followed[12], followed[14])):
        np.testing.assert_allclose(both.q[k], alone.q, atol=1e-4)
        np.testing.assert_allclose(both.T_world_object[k], alone.T_world_object, atol=1e-4)


def test_what_the_robots_spheres_hold_is_not_looked_at():
    spheres, robot, q = panda_spheres(), panda(), jnp.array([0.0, 0.1, 0.0, -2.0, 0.0, 2.1, 0.8])
    centers, radii = robot_spheres(robot, spheres, q)
    eye = camera()
    uv = jnp.array([[160, 120]])
    T = eye.T_world_camera
    for offset, known in ((0.5 * float(radii[5]), False), (float(radii[5]) + 0.02, True)):
        at = np.asarray(centers[5]) - T[:3, 3]
        z = float((at @ T[:3, :3])[2]) if known else 1.0
        point = T[:3, 3] + T[:3, :3] @ np.asarray(eye.points(uv.astype(float), jnp.array([z])))[0]
        moved = jnp.asarray(point + np.array([offset, 0.0, 0.0]))[None]
        rays = rays_at(jnp.full((240, 320), z), eye, uv, jnp.ones(1, bool), moved, radii[5:6], 0.01)
        assert bool(rays.known[0]) is known
    nothing = jnp.array([[0.0, jnp.nan], [-1.0, jnp.inf]])
    small = camera(2, 2)
    pixels = jnp.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    assert not rays_at(nothing, small, pixels, jnp.ones(4, bool), centers, radii, 0.0).known.any()


def test_wrong_arguments_are_named(watched):
    model, step, images, _ = watched
    with pytest.raises(ShapeError, match="q has shape"):
        start_estimate(model, SETTINGS, np.eye(4), [0.0])
    with pytest.raises(RigidTransformError):
        start_estimate(model, SETTINGS, 2 * np.eye(4), [0.0, 0.0])
    with pytest.raises(ShapeError, match="expected \\(240, 320\\)"):
        step(start_estimate(model, SETTINGS, np.eye(4), [0.0, 0.0]), images[0][:100])
    with pytest.raises(ConfigurationError, match="object_tracker.trust"):
        ObjectTrackerSettings(trust=0.0)
