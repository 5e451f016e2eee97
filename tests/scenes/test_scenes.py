"""The scenes: where everything stands, what counts as touched, and that MJX takes them."""

import mujoco
import numpy as np
import pytest

from jaxrmp import ConfigurationError, UnknownNameError, kinematics, scenes, synthetic
from jaxrmp.kinematics import forward_kinematics, panda

HOME = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])
TASKS = {"drawer": "drawer_closing", "door": "door_reaching"}


@pytest.fixture(scope="module", params=scenes.SCENES)
def scene(request):
    return scenes.scene(request.param)


def test_the_arm_inside_is_the_panda(scene):
    data = scene.data(HOME)
    for frame in ("panda_link7", "panda_leftfinger", "panda_rightfinger"):
        expected = np.asarray(forward_kinematics(panda(), HOME, frame))
        np.testing.assert_allclose(data.body(frame).xpos, expected[:3, 3], atol=1e-6)
    original = mujoco.MjModel.from_xml_path(str(kinematics.PANDA_MODEL))
    for joint in panda().joint_names:
        assert scene.model.joint(joint).range.tolist() == original.joint(joint).range.tolist()
    for body in ("panda_link3", "panda_link7", "panda_leftfinger"):
        assert scene.model.body(body).mass == original.body(body).mass
    np.testing.assert_array_equal(scene.model.actuator_ctrlrange[:, 1], [87.0] * 4 + [12.0] * 3)


def test_the_object_is_where_it_is_put_and_carries_the_furniture(scene):
    T = np.eye(4)
    T[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    T[:3, 3] = [0.9, 0.3, 0.4]
    data = scene.data(HOME)
    part = "drawer" if "drawer" in scene.name else "door"
    before = np.linalg.inv(scene.object_pose(data)) @ [*data.body(part).xpos, 1.0]
    scene.place(data, T)
    mujoco.mj_forward(scene.model, data)
    np.testing.assert_allclose(scene.object_pose(data), T, atol=1e-12)
    np.testing.assert_allclose(np.linalg.inv(T) @ [*data.body(part).xpos, 1.0], before, atol=1e-9)


def test_mjx_takes_the_model(scene):
    from mujoco import mjx

    assert mjx.put_model(scene.model).nq == scene.model.nq


@pytest.mark.parametrize("name", TASKS)
def test_synthetic_demonstrations_fit_the_furniture(name):
    scene, data = scenes.scene(name), None
    for demonstration in synthetic.synthetic_demonstrations(TASKS[name]):
        q = demonstration.q
        if name == "door":
            scene = scene.with_object(demonstration.pose("door_handle"))
        data = scene.data(q[0])
        for t in range(0, len(q), 10):
            data.qpos[scene.arm_qpos] = q[t]
            mujoco.mj_forward(scene.model, data)
            assert scene.contacts(data) == []
        assert scene.clearance(data) > 0.01
        if name == "drawer":  # the fingers end where the handle of the closed drawer is, give or take
            data.qpos[scene.arm_qpos] = q[-1]
            data.joint(scene.joint).qpos[0] = 0.0
            mujoco.mj_forward(scene.model, data)
            handle, fingers = scene.model.geom("drawer_handle").id, scene.arm_geoms[-4:]
            gap = min(mujoco.mj_geomDistance(scene.model, data, handle, int(g), 0.1, None) for g in fingers)
            assert -0.015 < gap < 0.015


def test_with_nothing_to_keep_off_no_clearance_is_claimed():
    alone = scenes.arm_alone()
    assert not alone.keeps_off and alone.clearance(alone.data(HOME)) == np.inf
    from jaxrmp.cli._output import clearance_in_words

    assert clearance_in_words({"min_clearance_m": np.inf}) == "not checked"
    assert clearance_in_words({"min_clearance_m": 0.0123}) == "12.3"


def test_clearance_is_the_least_distance(scene):
    data = scene.data(HOME)
    found = scene.clearance(data)
    every = [
        mujoco.mj_geomDistance(scene.model, data, int(a), int(b), 1.0, None)
        for a in scene.arm_geoms
        for b in scene.forbidden
        if scene.model.geom(b).name != "floor"
    ]
    assert found == pytest.approx(min(every), abs=1e-9)


def test_the_policy_is_told_where_the_cylinder_is():
    scene = scenes.drawer_obstacle(cylinder=scenes.Cylinder((-0.1, 0.3)))
    data = scene.data(HOME)
    world = scene.obstacles()
    obstacle = scene.model.geom("obstacle").id
    center = data.geom_xpos[obstacle]
    assert world.size == 1
    np.testing.assert_allclose(center[:2], scene.T_world_object[:2, 3] + [-0.1, 0.3], atol=1e-9)
    np.testing.assert_allclose(float(world.signed_distance(center)[0]), -scene.cylinder.radius, atol=1e-6)
    assert scenes.scene("drawer").obstacles().size == 0


def test_a_start_in_collision_is_refused():
    scene = scenes.scene("drawer")
    with pytest.raises(ConfigurationError, match=r"is in collision: panda_.* - floor"):
        scene.data(np.array([0.0, 1.7, 0.0, -0.1, 0.0, 1.6, 0.8]))
    with pytest.raises(ConfigurationError, match="expected 7 finite joint positions"):
        scene.data(np.full(7, np.nan))


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: scenes.scene("drawr"), UnknownNameError, "Did you mean 'drawer'"),
        (lambda: scenes.scene("nowhere.py"), ConfigurationError, "there is no such file"),
        (
            lambda: scenes.drawer_obstacle(cylinder=scenes.Cylinder(radius=-1)),
            ConfigurationError,
            "expected a positive radius",
        ),
    ],
)
def test_mistakes_are_explained(call, error, message):
    with pytest.raises(error, match=message):
        call()
