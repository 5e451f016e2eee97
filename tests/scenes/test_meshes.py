"""Menagerie's looks for pictures, from a checkout of the same layout, with a small mesh on every body."""

import numpy as np
import pytest

from jaxrmp import RobotError
from jaxrmp.kinematics import PANDA_MODEL
from jaxrmp.scenes import panda_meshes, picture_model, scene

mujoco = pytest.importorskip("mujoco")

OBJ = "v 0 0 0\nv 0.05 0 0\nv 0 0.06 0\nv 0 0 0.09\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
NAMES = {f"panda_link{i}": f"link{i}" for i in range(8)} | {
    "panda_hand": "hand",
    "panda_leftfinger": "left_finger",
    "panda_rightfinger": "right_finger",
}
Q = np.array([0.3, -0.5, 0.2, -2.0, 0.4, 1.9, 0.6])


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    root = tmp_path_factory.mktemp("menagerie")
    folder = root / "franka_emika_panda"
    (folder / "assets").mkdir(parents=True)
    (folder / "assets" / "part.obj").write_text(OBJ)
    spec = mujoco.MjSpec.from_file(str(PANDA_MODEL))
    spec.meshdir = str(folder / "assets")
    spec.add_mesh(name="part", file="part.obj", scale=[2.0, 1.0, 1.0])
    spec.add_material(name="grey", rgba=[0.2, 0.3, 0.4, 1.0])
    for body in spec.bodies:
        if body.name in NAMES:
            body.name = NAMES[body.name]
            body.add_geom(
                name=f"seen_{body.name}", type=7, meshname="part", material="grey", group=2, pos=[0.01, 0.02, 0.03],
                quat=[0.8, 0.6, 0, 0], contype=0, conaffinity=0, mass=0,
            )  # fmt: skip
    text = spec.to_xml()
    for own, name in NAMES.items():
        text = text.replace(f'"{own}"', f'"{name}"')
    (folder / "panda.xml").write_text(text.replace(str(folder / "assets"), "assets"))
    return root


@pytest.fixture(scope="module")
def place():
    return scene("drawer")


def test_meshes_are_where_their_own_model_has_them(checkout, place, monkeypatch):
    monkeypatch.setenv("MENAGERIE_ROOT", str(checkout))
    dressed = picture_model(place)
    theirs = mujoco.MjModel.from_xml_path(str(panda_meshes()))
    states = []
    for model in (dressed, theirs):
        data = mujoco.MjData(model)
        for joint, q in zip(place.robot.joint_names, Q, strict=True):
            data.joint(joint).qpos[0] = q
        for j in range(model.njnt):
            if "finger" in model.joint(j).name:
                data.qpos[model.jnt_qposadr[j]] = 0.04
        mujoco.mj_kinematics(model, data)
        seen = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
        states.append((data.geom_xpos[seen], data.geom_xmat[seen], model.geom_bodyid[seen]))
    assert len(states[0][0]) == len(NAMES)
    order = [np.argsort(positions[:, 2]) for positions, _, _ in states]
    for a, b in zip(states[0][:2], states[1][:2], strict=True):
        np.testing.assert_allclose(a[order[0]], b[order[1]], atol=1e-6)


def test_looks_change_no_physics(checkout, place, monkeypatch):
    monkeypatch.setenv("MENAGERIE_ROOT", str(checkout))
    dressed, plain = picture_model(place), place.model
    for name in ("nq", "nv", "nu", "nmocap", "nbody"):
        assert getattr(dressed, name) == getattr(plain, name)
    np.testing.assert_array_equal(dressed.body_mass, plain.body_mass)
    np.testing.assert_array_equal(dressed.body_inertia, plain.body_inertia)
    touching = dressed.geom_contype + dressed.geom_conaffinity
    assert (touching[dressed.geom_type == mujoco.mjtGeom.mjGEOM_MESH] == 0).all()
    assert (dressed.geom_rgba[[dressed.geom(plain.geom(int(g)).name).id for g in place.arm_geoms], 3] == 0).all()


def test_without_meshes_the_scene_is_drawn_with_a_floor_and_light_alone(place, monkeypatch, tmp_path):
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    assert panda_meshes() is None
    model, own = picture_model(place), place.model
    assert model.nmesh == own.nmesh and model.nq == own.nq and model.ngeom == own.ngeom
    assert model.nlight > own.nlight and model.ntex > own.ntex
    np.testing.assert_array_equal(model.geom_rgba[1:], own.geom_rgba[1:])  # all but the floor's


def test_another_robot_is_refused(place, tmp_path):
    other = tmp_path / "arm.xml"
    other.write_text("<mujoco><worldbody><body name='link0'/></worldbody></mujoco>")
    with pytest.raises(RobotError, match=r"not Menagerie's Panda: it has no bodies hand, left_finger"):
        picture_model(place, other)
    with pytest.raises(RobotError, match="cannot be read"):
        picture_model(place, tmp_path / "nowhere.xml")
