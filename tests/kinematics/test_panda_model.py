"""The built-in Panda as a simulation model: it compiles, stands without contact, and steps in MuJoCo and MJX."""

import contextlib
import io

import mujoco
import numpy as np
import pytest

from jaxrmp.kinematics import PANDA_MODEL, panda
from jaxrmp.kinematics._make_panda_numbers import panda_of_its_file


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_path(str(PANDA_MODEL))


def test_home_is_free_of_contact_and_the_arm_holds_still_under_gravity_torques(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    start = data.qpos.copy()
    for _ in range(500):
        data.ctrl[:7] = data.qfrc_bias[:7]
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.qpos[:7], start[:7], atol=0.02)
    assert abs(data.qpos[7] - data.qpos[8]) < 1e-3  # the fingers move together


def test_neighbouring_links_never_touch(model):
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(500):
        data.qpos[:7] = rng.uniform(panda().lower, panda().upper)
        mujoco.mj_forward(model, data)
        for contact in data.contact[: data.ncon]:
            bodies = sorted(model.geom_bodyid[g] for g in contact.geom)
            assert bodies[1] - bodies[0] >= 3, [model.body(b).name for b in bodies]


def test_limits_and_masses_are_the_published_ones(model):
    arm = [model.joint(name).id for name in panda().joint_names]
    np.testing.assert_array_equal(model.jnt_range[arm], np.stack([panda().lower, panda().upper], axis=1))
    np.testing.assert_array_equal(model.actuator_ctrlrange[:7, 1], [87] * 4 + [12] * 3)
    assert model.body_mass[1:].sum() == pytest.approx(17.45, abs=0.05)


def test_its_plain_numbers_are_those_of_its_file():
    """Else: python -m jaxrmp.kinematics._make_panda_numbers"""
    of_file, of_numbers = panda_of_its_file(), panda()
    assert of_numbers.fingerprint == of_file.fingerprint  # numbers to 1e-9, names, and how they hang together
    assert of_numbers.name == of_file.name and of_numbers.source == of_file.source == str(PANDA_MODEL.resolve())
    for name in ("lower", "upper", "velocity_limit"):
        np.testing.assert_allclose(getattr(of_numbers, name), getattr(of_file, name), rtol=1e-14)


def test_mjx_takes_the_model(model):
    with contextlib.redirect_stdout(io.StringIO()):
        mjx = pytest.importorskip("mujoco.mjx", reason="mujoco-mjx is not installed")
    put = mjx.put_model(model, impl="jax")
    assert put.nq == 9
