"""A camera's pose from rendered depth images of a robot: how exactly, and that what does not give it is told."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import CalibrationError, NoGeometryError, ShapeError
from jaxrmp._rotations import pose, rotation_angle, rotation_of_vector
from jaxrmp.kinematics import load_robot_from_string
from jaxrmp.perception import ObjectTrackerSettings, calibrate_camera, robot_object
from jaxrmp.perception._nearest import nearest, parts_at
from jaxrmp.perception._see_through import seen_through
from jaxrmp.world._components import components

from .posed import ARM, POST, POSTURES, camera, images, robot_of

SETTINGS = ObjectTrackerSettings()


@pytest.fixture(scope="module")
def arm(tmp_path_factory, can_draw):
    """The arm as an object, its images, and the camera at its true pose."""
    if not can_draw:
        pytest.skip("needs OSMesa or a display")
    robot = robot_of(ARM, tmp_path_factory.mktemp("arm"))
    return robot_object(robot, 800, sets=8), images(ARM, POSTURES, camera()), camera()


def rough(eye, far=0.05, turned=15.0, seed=0):
    """The camera `far`, m, and `turned`, degrees, from where it is."""
    way, axis = np.random.default_rng(seed).normal(size=(2, 3))
    way, axis = far * way / np.linalg.norm(way), np.radians(turned) * axis / np.linalg.norm(axis)
    T = np.asarray(eye.T_world_camera)
    return dataclasses.replace(eye, T_world_camera=pose(T[:3, 3] + way, T[:3, :3] @ rotation_of_vector(axis)))


@pytest.mark.parametrize("seed", [0, 1])
def test_from_a_rough_guess_the_camera_is_found_and_says_how_sure_that_is(arm, seed):
    model, depths, eye = arm
    found = calibrate_camera(model, SETTINGS, depths, POSTURES, rough(eye, seed=seed))
    off = np.linalg.inv(eye.T_world_camera) @ found.T_world_camera
    turned = rotation_angle(off[:3, :3])
    assert np.linalg.norm(off[:3, 3]) < 0.003 and np.degrees(turned) < 0.3
    assert found.seen.all() and found.rms < 0.005 and (found.fits > 0.1).all()
    error = np.append(off[:3, 3], 0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]]))
    assert error @ np.linalg.solve(found.covariance, error) < 30  # of six numbers: 22 once in a thousand
    assert (np.sqrt(np.diag(found.covariance)) < [0.005] * 3 + [0.01] * 3).all()


def test_a_robot_that_is_not_there_or_elsewhere_than_its_joints_say_is_told(arm):
    model, depths, eye = arm
    nothing = np.where(np.isfinite(depths), np.float32(2.0), np.float32(2.0))
    with pytest.raises(CalibrationError, match="not seen where it would have to be in 5 of 5"):
        calibrate_camera(model, SETTINGS, nothing, POSTURES, eye)
    with pytest.raises(CalibrationError, match="not seen"):
        calibrate_camera(model, SETTINGS, depths, POSTURES[::-1] + [1.5, -0.8, 0.9], eye)


def test_postures_that_leave_the_camera_free_are_told(tmp_path, can_draw):
    if not can_draw:
        pytest.skip("needs OSMesa or a display")
    model, q = robot_object(robot_of(POST, tmp_path), 800, sets=8), np.array([[0.0], [1.0], [2.0]])
    with pytest.raises(CalibrationError, match="do not say where the camera is"):
        calibrate_camera(model, SETTINGS, images(POST, q, camera()), q, rough(camera(), 0.01, 2.0))


def test_rays_that_pass_a_mesh_meet_nothing_and_those_through_it_say_how_far_its_outline_is(arm):
    model = arm[0]
    parts = parts_at(model, jnp.zeros(3))
    eye = components(jnp.array([0.0, -2.0, 0.68]))  # the mesh begins 0.6 m up, 0.05 m to the side of the axis
    ends = jnp.array([[0.0, 2.0, 0.68], [0.3, 2.0, 0.68]])
    found = seen_through(parts, components(ends), eye, jnp.full(2, 0.99))
    assert float(found.distance[0]) < -0.01 and int(found.link[0]) == 3
    assert float(found.distance[1]) == 0.0
    on = jnp.stack(found.at, axis=-1)[:1]
    again = nearest(model, parts, components(on), eye)
    np.testing.assert_allclose(again.distance[0], found.distance[0], atol=1e-4)


def test_wrong_arguments_are_named(arm):
    model, depths, eye = arm
    with pytest.raises(ShapeError, match="depths has shape"):
        calibrate_camera(model, SETTINGS, depths[0], POSTURES, eye)
    with pytest.raises(ShapeError, match="q has shape"):
        calibrate_camera(model, SETTINGS, depths, POSTURES[:2], eye)
    with pytest.raises(NoGeometryError, match="read from no file"):
        robot_object(load_robot_from_string(POST))
