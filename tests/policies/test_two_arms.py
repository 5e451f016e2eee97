"""Two arms on one torso: both hands at once, each to its own target."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, ShapeError, acceleration, uncertified_leaves
from jaxrmp.kinematics import forward_kinematics, load_robot
from jaxrmp.policies import reaching_policy
from jaxrmp.simulation import rollout
from jaxrmp.world import SelfDistances, World, own_self_pairs, own_spheres

ARM = """<body name="{0}_base" pos="0 {1} .4"><geom size=".06"/>
<body name="{0}_upper"><joint name="{0}_1" axis="0 0 1" range="-2 2"/><joint name="{0}_2" axis="0 1 0" range="-2 2"/>
<geom pos=".2 0 0" size=".06"/><body name="{0}_fore" pos=".3 0 0"><joint name="{0}_3" axis="0 1 0" range="-2.5 2.5"/>
<geom pos=".2 0 0" size=".05"/><body name="{0}_hand" pos=".3 0 0"><joint name="{0}_4" axis="0 0 1" range="-2 2"/>
<joint name="{0}_5" axis="0 1 0" range="-2 2"/><joint name="{0}_6" axis="1 0 0" range="-3 3"/>
<geom pos=".1 0 0" size=".05"/></body></body></body></body>"""
TWO = f"""<mujoco model="two"><compiler angle="radian" autolimits="true"/><worldbody>
<body name="torso"><joint name="turn" axis="0 0 1" range="-1 1"/>
<geom pos="0 0 .1" size=".1"/>{ARM.format("left", 0.25)}{ARM.format("right", -0.25)}</body>
</worldbody></mujoco>"""
REST = np.array([0.0, 0.3, 0.6, 0.8, 0.2, 0.3, 0.0, -0.3, 0.6, 0.8, -0.2, 0.3, 0.0])
HANDS = ("left_hand", "right_hand")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("two")
    (folder / "two.xml").write_text(TWO)
    return folder


@pytest.fixture(scope="module")
def robot(folder):
    return load_robot(folder / "two.xml")


@pytest.fixture(scope="module")
def both(robot):
    return reaching_policy(robot, HANDS, REST)


def poses(robot, q, frames=HANDS):
    return np.stack([np.asarray(forward_kinematics(robot, q, frame)) for frame in frames])


def test_both_hands_reach_their_own_targets_and_keep_off_each_other(robot, both):
    """The targets are crossed: each hand's is before the other shoulder."""
    asked = REST + np.array([0.2, -0.6, 0.2, 0.1, -0.2, 0.1, 0.4, 0.5, 0.5, 0.2, 0.3, 0.1, -0.4])
    goals, start = poses(robot, asked), jnp.asarray(REST, jnp.float32)
    tree = both.tree(goals, World())
    assert uncertified_leaves(tree) == ()
    path = jax.jit(lambda tree: rollout(tree, start, duration=6.0, dt=0.002, warn=False))(tree)
    off = poses(robot, path.q[-1]) - goals
    assert np.linalg.norm(off[:, :3, 3], axis=1).max() < 0.01 and np.abs(off[:, :3, :3]).max() < 0.1
    spheres = own_spheres(robot)
    own = SelfDistances(spheres.points(robot), own_self_pairs(robot, spheres), spheres.radii)
    assert jax.jit(jax.vmap(lambda q: own(q).min()))(path.q[::50]).min() > 0


def test_one_hand_named_alone_is_the_same_policy_but_for_the_targets_axis(robot):
    one, listed = reaching_policy(robot, HANDS[0], REST), reaching_policy(robot, HANDS[:1], REST)
    T = poses(robot, REST, HANDS[:1])
    trees = [one.tree(T[0], World()), listed.tree(T, World())]
    assert jax.tree.structure(trees[0]) == jax.tree.structure(trees[1])
    jax.tree.map(np.testing.assert_array_equal, *trees)


def test_targets_move_without_compiling_anew_and_have_gradients(robot):
    both, traces = reaching_policy(robot, HANDS, REST, self_collision=False), []
    q, still = jnp.asarray(REST, jnp.float32), jnp.zeros(13, jnp.float32)

    @jax.jit
    @jax.vmap
    def pull(T):
        traces.append(0)
        return jax.value_and_grad(lambda T: acceleration(both.tree(T, World()), q, still)[7])(T)

    goals = jnp.stack([jnp.asarray(poses(robot, 0.8 * REST), jnp.float32)] * 2).at[0, 1, 0, 3].add(0.1)
    (one, other), slope = pull(goals)
    pull(goals[::-1])
    assert len(traces) == 1 and abs(one - other) > 0.1
    assert np.isfinite(slope).all() and np.abs(slope[:, 1, :3, 3]).max() > 0.1


def test_hands_and_targets_that_do_not_fit_are_told(robot, both):
    with pytest.raises(ShapeError, match=r"shape \(4, 4\), expected \(2, 4, 4\): a pose for each of 2\."):
        both.tree(np.eye(4), World())
    with pytest.raises(ShapeError, match=r"shape \(2, 4, 4\), expected \(4, 4\): a pose"):
        reaching_policy(robot, HANDS[0]).tree(poses(robot, REST), World())
    for wrong in ((), ("left_hand", "left_hand")):
        with pytest.raises(ConfigurationError, match="at least one frame, and each once"):
            reaching_policy(robot, wrong)
