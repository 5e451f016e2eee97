"""Distances of points and outlines: against the world's, the renderer's geometry, and their Jacobians."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxrmp import NoGeometryError, RobotError, UnknownNameError
from jaxrmp._rotations import rotation_of_vector
from jaxrmp.kinematics import forward_kinematics
from jaxrmp.perception import depth_renderer, object_model
from jaxrmp.perception._nearest import jacobian, nearest, parts_at
from jaxrmp.perception._see_through import seen_through
from jaxrmp.world._components import components

from .conftest import T_WORLD_OBJECT, camera, model_and_data, thing

Q = jnp.array([0.5, 0.08])


def in_base(p_world):
    return (p_world - T_WORLD_OBJECT[:3, 3]) @ T_WORLD_OBJECT[:3, :3]


def seen_points(m, data, eye):
    """Points of all pixels of an exact picture, in the object's base, and the camera there."""
    with depth_renderer(m, eye.width, eye.height) as render:
        depth = render(data, eye)
    v, u = np.mgrid[: eye.height, : eye.width]
    uv = jnp.asarray(np.stack([u, v], -1).reshape(-1, 2), float)
    T = eye.T_world_camera
    p = np.asarray(eye.points(uv, jnp.asarray(depth.ravel(), uv.dtype))) @ T[:3, :3].T + T[:3, 3]
    return p, components(jnp.asarray(in_base(T[:3, 3])))


def test_links_are_where_mujoco_has_them():
    m, data = model_and_data()
    model = thing(m)
    assert model.robot.joint_names == ("hinge", "slide") and model.links == (0, 1, 2)
    for name in ("door", "drawer"):
        T = T_WORLD_OBJECT @ np.asarray(forward_kinematics(model.robot, Q, name))
        np.testing.assert_allclose(T[:3, 3], data.body(name).xpos, atol=1e-6)
        np.testing.assert_allclose(T[:3, :3].ravel(), data.body(name).xmat, atol=1e-6)


def test_what_the_renderer_shows_of_the_object_is_at_distance_zero_and_nothing_is_seen_through(can_draw):
    if not can_draw:
        pytest.skip("needs OSMesa or a display")
    m, data = model_and_data()
    model = thing(m)
    p_world, eye = seen_points(m, data, camera())
    p = components(jnp.asarray(in_base(p_world)))
    parts = parts_at(model, Q)
    found = nearest(model, parts, p, eye)
    floor = p_world[:, 2] < 1e-3
    d = np.abs(np.asarray(found.distance))[~floor]
    assert len(d) > 10_000
    assert np.quantile(d, 0.9) < 1e-6 and d.max() < 2e-3  # what is round is drawn with facets
    assert set(np.unique(np.asarray(found.link)[~floor])) == {0, 1, 2}
    through = np.asarray(seen_through(parts, p, eye, jnp.full(len(p_world), 0.98)).distance)
    assert through.min() > -4e-3  # of a pixel that is 3 mm wide


def test_outside_the_distance_is_the_worlds_and_within_a_panel_it_is_to_its_face_in_view():
    m, _ = model_and_data()
    model = thing(m)
    rng = np.random.default_rng(0)
    p = jnp.asarray(rng.uniform(-0.5, 0.5, (500, 3)))
    parts = parts_at(model, jnp.zeros(2))
    d = nearest(model, parts, components(p), components(jnp.array([0.0, -2.0, 1.0]))).distance
    T = [forward_kinematics(model.robot, jnp.zeros(2), model.robot.frame_names[k]) for k in model.links]
    all_d = [w.signed_distance((p - t[:3, 3]) @ t[:3, :3]) for w, t in zip(model.shapes, T, strict=True)]
    expected = jnp.concatenate(all_d, axis=1)
    outside = (expected > 0).all(1)
    assert outside.sum() > 300
    np.testing.assert_allclose(d[outside], expected[outside].min(1), atol=1e-6)
    behind = nearest(
        model, parts, components(jnp.array([[0.1, -0.013, -0.1]])), components(jnp.array([0.1, -2.0, 0.0]))
    )
    np.testing.assert_allclose(behind.distance, [-0.017], atol=1e-6)  # the panel is 2 cm, its front at y = -0.03
    np.testing.assert_allclose(np.concatenate(behind.gradient), [0, -1, 0], atol=1e-6)


def test_a_ray_beyond_a_panels_edge_says_how_far_it_is_from_it():
    m, _ = model_and_data()
    model = object_model(m, "drawer", 100)
    eye, behind = components(jnp.array([0.0, -2.0, 0.0])), jnp.array([[0.0775, 1.0, 0.02]])
    found = seen_through(parts_at(model, jnp.zeros(0)), components(behind), eye, jnp.array([0.9]))
    # At the front face, 1.99 m away, the ray is 0.0514 m beside the middle, at the back face a little more.
    assert -0.0289 < float(found.distance[0]) < -0.0280
    assert float(found.gradient[0][0]) > 0.99
    short = seen_through(parts_at(model, jnp.zeros(0)), components(behind), eye, jnp.array([0.5]))
    assert float(short.distance[0]) == 0.0


@pytest.mark.parametrize("what", ["distance", "outline"])
def test_jacobians_are_those_of_finite_differences(what):
    with jax.enable_x64(True):
        m, _ = model_and_data()
        model = thing(m)
        rng = np.random.default_rng(1)
        q = jnp.array([0.5, 0.08])
        eye = jnp.array([-0.4, -1.05, 0.7])
        p = jnp.concatenate([jnp.asarray(look[0]) for look in model.look]).astype(float)
        if what == "outline":
            p = eye + 1.5 * (p - eye)
        p = p[jnp.asarray(rng.permutation(len(p))[:400])]
        middle = jnp.asarray(model.middle, float)

        def residuals(change):
            """Of points and a camera that stay in the world, as the base is moved and turned, and the joints move."""
            turn = rotation_of_vector(change[3:6])

            def local(x):
                return (x - change[:3] - middle) @ turn + middle

            e = local(eye)
            parts = parts_at(model, q + change[6:])
            if what == "distance":
                found = nearest(model, parts, components(local(p)), components(e))
            else:
                found = seen_through(parts, components(local(p)), components(e), jnp.full(len(p), 0.95))
            return found.distance, jnp.stack(jacobian(model, parts, found), axis=1)

        d, J = residuals(jnp.zeros(8))
        h, good, differences = 1e-6, np.ones(len(p), bool), []
        for k in range(8):
            ahead, back = (residuals(s * h * jnp.eye(8)[k])[0] for s in (1, -1))
            differences.append((ahead - back) / (2 * h))
            good &= np.abs(ahead - 2 * d + back) < 1e-9  # not where the nearest part or face changes
        good &= np.abs(d) > 1e-4
        assert good.sum() > (300 if what == "distance" else 60)
        np.testing.assert_allclose(np.stack(differences, axis=1)[good], J[good], atol=2e-5)
        assert (np.abs(J[good]).max(0) > 0.01).all()  # every unknown is seen


def test_points_to_look_for_are_on_and_round_the_surfaces():
    m, _ = model_and_data()
    model = thing(m)
    assert [look.shape for look in model.look] == [(4, 600, 3), (4, 300, 3), (4, 300, 3)]
    for world, look in zip(model.shapes, model.look, strict=True):
        d = np.asarray(jnp.abs(world.signed_distance(jnp.asarray(look[0]))).min(1))
        assert d.max() < 0.03 * np.sqrt(3) + 1e-6 and d.max() > 0.02


def test_what_is_no_object_is_refused():
    import mujoco

    m, _ = model_and_data()
    with pytest.raises(UnknownNameError, match="Did you mean 'door'"):
        object_model(m, "dor")
    with pytest.raises(NoGeometryError, match="plane"):
        object_model(m)
    ball = '<mujoco><worldbody><body name="b"><body><joint type="ball"/><geom size="0.1"/></body></body></worldbody>'
    with pytest.raises(RobotError, match="neither a hinge nor a slide"):
        object_model(mujoco.MjModel.from_xml_string(f"{ball}</mujoco>"), "b")


def test_an_object_comes_from_a_file_too(tmp_path):
    file = tmp_path / "stick.xml"
    file.write_text(
        '<mujoco><worldbody><body name="stick"><geom size="0.1 0.2" type="cylinder"/></body></worldbody></mujoco>'
    )
    model = object_model(file, "stick", 50)
    assert model.num_joints == 0 and model.look[0].shape == (16, 50, 3)


def test_a_meshs_slopes_are_the_same_compiled():
    """Where a program knew the object, points inside of its grid were taken to be a rounding error beyond it."""
    import mujoco

    wedge = "-.15 -.1 0 .15 -.1 0 .15 .1 0 -.15 .1 0 -.15 -.1 .2 -.15 .1 .2"
    m = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="w" vertex="{wedge}"/></asset>
        <worldbody><body name="w"><geom type="mesh" mesh="w"/></body></worldbody></mujoco>"""
    )
    model, q = object_model(m, "w", 100, spacing=0.005), jnp.zeros(0)
    eye, R = components(jnp.array([-0.7, -0.3, 0.8])), rotation_of_vector(np.array([0.0, 0.0, 0.5]))
    p = jnp.asarray(
        np.random.default_rng(0).uniform([-0.15, -0.1, 0.0], [0.15, 0.1, 0.2], (2000, 3)) @ R.T, jnp.float32
    )

    def slopes(p, R):
        local = [R[0, i] * p[:, 0] + R[1, i] * p[:, 1] + R[2, i] * p[:, 2] for i in range(3)]
        return jnp.stack(nearest(model, parts_at(model, q), tuple(local), eye).gradient)

    R = jnp.asarray(R, jnp.float32)
    off = np.abs(np.asarray(jax.jit(slopes)(p, R)) - np.asarray(slopes(p, R))).max(0)
    assert np.mean(off > 0.01) < 0.01  # but for points on the borders of cells


def test_of_an_object_what_is_drawn_counts(tmp_path):
    boxes = '<geom type="box" size=".1 .1 .1"/><geom type="box" size=".3 .3 .3" group="3"/>'
    text = f'<mujoco><worldbody><body name="thing">{boxes}</body></worldbody></mujoco>'
    model = object_model(mujoco.MjModel.from_xml_string(text), "thing")
    assert sum(world.size for world in model.shapes) == 1
    shape = '<geometry><box size=".2 .2 {}"/></geometry>'
    link = f"<visual>{shape.format(0.1)}</visual><collision>{shape.format(0.5)}</collision>"
    (tmp_path / "thing.urdf").write_text(f'<robot name="thing"><link name="base">{link}</link></robot>')
    (seen,) = object_model(tmp_path / "thing.urdf").shapes
    np.testing.assert_allclose(np.asarray(seen.boxes.half_extents), [[0.1, 0.1, 0.05]])
