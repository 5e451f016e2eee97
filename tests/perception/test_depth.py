"""The camera, the renderer's depth against known geometry, and the noise's statistics."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, RigidTransformError, ShapeError
from jaxrmp.perception import KINECT, Camera, DepthNoise, axial_sigma, depth_renderer, measured_depth

from .conftest import camera, model_and_data


def test_pixels_and_points_are_inverse_of_each_other():
    eye = Camera(np.array([500.0, 520.0]), np.array([300.0, 250.0]))
    uv = jnp.array([[0.0, 0.0], [639.0, 479.0], [300.0, 250.0]])
    p = eye.points(uv, jnp.array([0.5, 1.0, 2.0]))
    back, seen = eye.pixel(p)
    np.testing.assert_allclose(back, uv, atol=1e-3)
    assert seen.all() and p[2].tolist() == [0.0, 0.0, 2.0]
    assert not eye.pixel(-p)[1].any() and not eye.pixel(jnp.array([5.0, 0.0, 1.0]))[1]


def test_a_camera_that_looks_somewhere_has_that_in_its_middle_and_the_world_upright():
    eye = Camera.looking([1.0, 2.0, 3.0], [0.0, 0.0, 0.5])
    T = np.linalg.inv(eye.T_world_camera)
    middle, above = ((T @ [0.0, 0.0, z, 1.0])[:3] for z in (0.5, 0.6))
    np.testing.assert_allclose(eye.pixel(jnp.asarray(middle))[0], [319.5, 239.5], atol=1e-3)
    (u, v), _ = eye.pixel(jnp.asarray(above))
    assert v < 239 and abs(u - 319.5) < 1e-2
    with pytest.raises(ConfigurationError, match="vertical"):
        Camera.looking([0, 0, 1], [0, 0, 0])
    with pytest.raises(RigidTransformError):
        Camera(np.ones(2), np.zeros(2), 2 * np.eye(4))
    with pytest.raises(ShapeError, match="focal"):
        Camera(np.ones(3), np.zeros(2))


def test_rendered_depth_is_that_of_a_plane_and_a_sphere_in_metres(can_draw):
    if not can_draw:
        pytest.skip("needs OSMesa or a display")
    import mujoco

    m = mujoco.MjModel.from_xml_string(
        '<mujoco><visual><global offwidth="640" offheight="480"/><quality numslices="200" numstacks="200"/></visual>'
        '<worldbody><geom type="plane" size="5 5 .1"/><geom type="sphere" size=".1" pos="0.3 0.1 0.5"/></worldbody>'
        "</mujoco>"
    )
    data = mujoco.MjData(m)
    mujoco.mj_forward(m, data)
    pose = Camera.looking([1.0, 0.2, 1.5], [0.0, 0.0, 0.3]).T_world_camera
    eye = Camera(np.array([500.0, 550.0]), np.array([300.0, 260.0]), pose)  # neither square nor in the middle
    with depth_renderer(m, 640, 480) as render:
        depth = render(data, eye)
        with pytest.raises(ConfigurationError, match="320 x 240"):
            render(data, camera())
    v, u = np.mgrid[:480, :640]
    ray = np.stack([(u - 300) / 500, (v - 260) / 550, np.ones(u.shape)], -1) @ pose[:3, :3].T
    to_plane, center = -pose[2, 3] / ray[..., 2], np.array([0.3, 0.1, 0.5]) - pose[:3, 3]
    b, a = ray @ center, (ray**2).sum(-1)
    inside = b * b - a * (center @ center - 0.01)
    to_sphere = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, np.inf)
    on_plane, on_sphere = inside < -1e-3, inside > 2e-3
    assert (to_plane[on_plane] > 0).all() and on_sphere.sum() > 2000
    np.testing.assert_allclose(depth[on_plane], to_plane[on_plane], atol=1e-5)
    np.testing.assert_allclose(depth[on_sphere], to_sphere[on_sphere], atol=1e-3)  # of facets


def test_a_picture_larger_than_the_models_buffer_is_refused():
    m, _ = model_and_data()
    with pytest.raises(ConfigurationError, match="buffer"), depth_renderer(m, 1000, 1000):
        pass


@pytest.mark.parametrize("z", [0.8, 1.0, 2.0, 3.0])
def test_noise_has_the_spread_of_a_kinect_and_no_bias(z):
    noise = DepthNoise(quantum=0.0)
    found = measured_depth(noise, np.full((400, 500), z), np.random.default_rng(0))
    known = found[found > 0]
    sigma = 0.0012 + 0.0019 * (z - 0.4) ** 2
    assert np.std(known) == pytest.approx(sigma, rel=0.01)
    assert abs(known.mean() - z) < 5 * sigma / np.sqrt(len(known)) + 1e-6
    rounded = measured_depth(KINECT, np.full((400, 500), z), np.random.default_rng(0))
    assert np.std(rounded[rounded > 0]) == pytest.approx(axial_sigma(KINECT, z), rel=0.05)
    steps = 1 / (KINECT.quantum * rounded[rounded > 0].astype(float))
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)


def test_between_a_tenth_and_three_tenths_of_the_pixels_are_missing_and_what_is_too_near_or_far():
    rng = np.random.default_rng(0)
    shares = [(measured_depth(KINECT, np.full((100, 100), 1.0), rng) == 0).mean() for _ in range(200)]
    assert 0.08 < min(shares) < 0.13 and 0.27 < max(shares) < 0.32
    assert np.mean(shares) == pytest.approx(0.2, abs=0.02)
    assert not measured_depth(KINECT, np.array([[0.3, 9.0]]), rng).any()
    with pytest.raises(ConfigurationError, match="missing"):
        DepthNoise(missing=(0.5, 0.1))
    with pytest.raises(ConfigurationError, match="least"):
        DepthNoise(least=-1.0)


def test_marks_are_not_seen(can_draw):
    if not can_draw:
        pytest.skip("needs OSMesa or a display")
    import mujoco

    m = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom type="plane" size="5 5 .1"/><site pos="0 0 .3" size=".1"/></worldbody></mujoco>"""
    )
    data = mujoco.MjData(m)
    mujoco.mj_forward(m, data)
    eye = Camera.looking([0.01, 0, 2], [0, 0, 0], 64, 48)
    with depth_renderer(m, eye.width, eye.height) as render:
        assert abs(render(data, eye)[24, 32] - 2) < 0.01
