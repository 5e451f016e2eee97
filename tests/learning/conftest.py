"""What tests of learned skills have in common."""

import pickle
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import certificate
from jaxrmp.kinematics import panda
from jaxrmp.learning import Learning, learn, load_configuration
from jaxrmp.synthetic import synthetic_demonstrations

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(scope="session")
def door():
    """Four synthetic demonstrations of the door."""
    return synthetic_demonstrations("door_reaching", count=4)


@pytest.fixture(scope="session")
def door_flow(once, door) -> Learning:
    """What is learned from `door` by a flow with little work."""

    def make(folder: Path) -> None:
        configuration = load_configuration(CONFIGS / "door_reaching.toml", {"method": "flow", "flow.updates": 300})
        (folder / "learning.pickle").write_bytes(pickle.dumps(learn(configuration, panda(), door)))

    return pickle.loads((once("door-flow", make) / "learning.pickle").read_bytes())


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
