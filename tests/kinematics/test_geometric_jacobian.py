"""The geometric Jacobian against MuJoCo's, on robots with sliding joints and joints that follow others."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxrmp._errors import ShapeError, UnknownNameError
from jaxrmp.kinematics import forward_kinematics, geometric_jacobian, panda

FRAMES: dict[str, tuple[str, ...]] = {
    "panda": ("panda_hand", "panda_link4", "panda_rightfinger", "panda_link0"),
    "branching": ("right_finger", "column", "right_hook", "site:left_lower"),
}


def test_it_is_mujocos(oracle, random_configurations):
    robot, model = oracle.robot, oracle.model
    Q = random_configurations(robot, 50)
    for frame in FRAMES[robot.name]:
        with jax.enable_x64(True):
            ours = jax.jit(jax.vmap(lambda q, frame=frame: geometric_jacobian(robot, q, frame)))(Q)
        for q, J in zip(Q, ours, strict=True):
            oracle.set(q)
            linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
            if frame.startswith("site:"):
                mujoco.mj_jacSite(model, oracle.data, linear, angular, model.site(frame.removeprefix("site:")).id)
            else:
                mujoco.mj_jacBody(model, oracle.data, linear, angular, model.body(frame).id)
            np.testing.assert_allclose(J, np.concatenate([linear, angular]) @ oracle.expansion(), rtol=0, atol=1e-12)


def test_it_is_differentiable_in_the_precision_it_is_given():
    q = jnp.linspace(-0.5, 0.5, 7, dtype=jnp.float32)
    assert geometric_jacobian(panda(), q, "panda_hand").dtype == jnp.float32

    def height(q):
        return forward_kinematics(panda(), q, "panda_hand")[2, 3]

    with jax.enable_x64(True):
        q = jnp.linspace(-0.5, 0.5, 7)
        rate = jax.jacfwd(lambda q: geometric_jacobian(panda(), q, "panda_hand")[2])(q)
        np.testing.assert_allclose(rate, jax.hessian(height)(q), atol=1e-12)


def test_wrong_arguments_are_named():
    with pytest.raises(UnknownNameError, match="panda_hnad"):
        geometric_jacobian(panda(), jnp.zeros(7), "panda_hnad")
    with pytest.raises(ShapeError, match=r"q has shape \(6,\)"):
        geometric_jacobian(panda(), jnp.zeros(6), "panda_hand")
