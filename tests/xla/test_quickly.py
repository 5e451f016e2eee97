"""What is compiled quickly gives the same."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp.kinematics import frame_poses, panda
from jaxrmp.xla import known_options, quickly
from jaxrmp.xla._quickly import WITHOUT_OPTIMISING


def test_it_gives_what_jit_gives_and_compiles_once():
    traced = []

    def poses(robot, q):
        traced.append(q.shape)
        return jax.vmap(lambda q: frame_poses(robot, q, ("panda_hand", "panda_link3")))(q)

    robot, q = panda(), np.random.default_rng(0).uniform(-2, 2, (5, 7))
    quick = quickly(poses)
    with jax.enable_x64(True):
        found = quick(robot, jnp.asarray(q))
        quick(robot, jnp.asarray(q + 1))
        assert len(traced) == 1 and quick.__name__ == "poses"
        expected = jax.jit(poses)(robot, jnp.asarray(q))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


def test_options_that_this_jaxlib_does_not_know_are_left_out():
    expected = WITHOUT_OPTIMISING if jax.default_backend() == "cpu" else {}
    assert known_options(**WITHOUT_OPTIMISING, xla_of_no_version=True) == expected
