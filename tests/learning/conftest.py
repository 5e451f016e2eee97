"""What tests of learned skills have in common."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import certificate
from jaxrmp.kinematics import panda
from jaxrmp.learning import Learning


@pytest.fixture
def assert_skill_certified() -> Callable[[Learning], None]:
    """Of a skill of the Panda: the certificate of its whole tree, in double precision, at postures all over the joint
    range and on the demonstrations."""

    def check(learning: Learning) -> None:
        robot = panda()
        with jax.enable_x64(True):
            tree = jax.tree.map(lambda a: jnp.asarray(a, float), learning.skill.tree(robot))
            rng = np.random.default_rng(0)
            q = jnp.asarray(rng.uniform(robot.lower + 0.05, robot.upper - 0.05, (100, 7)))
            near = jnp.asarray(np.concatenate(learning.prepared.joints.q)[::20][:30])
            states = jnp.concatenate([q, near]), jnp.asarray(rng.normal(size=(130, 7)))
            found = jax.jit(jax.vmap(lambda q, qd: certificate(tree, q, qd)))(*states)
        assert float(found.residual.max()) < 1e-8
        assert all(leaf.certified for leaf in tree.leaves())

    return check
