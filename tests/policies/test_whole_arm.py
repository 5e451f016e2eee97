"""The whole arm's policy: what a skill's own policy would do to the arm, and does not with the leaves beside it."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import Batched, certificate, pullback, pytree
from jaxrmp.kinematics import ControlPoints, forward_kinematics, panda
from jaxrmp.leaves import Attractor, Damping
from jaxrmp.policies import whole_arm_policy
from jaxrmp.simulation import rollout
from jaxrmp.world import Capsules, SelfDistances, World, panda_self_pairs, panda_spheres

START = jnp.array([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.8], jnp.float32)
INTO_THE_BASE = jnp.array([[0.02, 0.0, 0.25]], jnp.float32)


@pytree
class PullsHand:
    """In place of a learned skill: draws the hand to a point, hard, and says nothing about anything else."""

    goal: Any
    R_object_hand: Any
    frames = ("panda_hand",)

    def tree(self, robot, T_world_object):
        hand = ControlPoints(robot, "panda_hand")
        goal = Attractor(self.goal[0], 10.0, 10.0, gain=20.0, damping_rate=4.0)
        return pullback(hand, Batched(goal, shared=True)) + Damping(jnp.float32(0.05), jnp.float32(2.0))


@pytest.fixture(scope="module")
def robot():
    return panda()


@pytest.fixture(scope="module")
def runs(robot):
    """The same pull into the base, by the skill alone and by the whole arm's policy; and to a free place beside."""
    hand = forward_kinematics(robot, START, "panda_hand")
    policy = whole_arm_policy(PullsHand(INTO_THE_BASE, np.asarray(hand)[:3, :3]), robot)
    roll = jax.jit(lambda tree: rollout(tree, START, duration=3.0, dt=0.001, warn=False))
    own = policy.tasks[0].tree(robot, jnp.eye(4))
    return policy, own, roll(own), roll(policy.tree(jnp.eye(4), World()))


def least_distance(robot, q):
    spheres = panda_spheres()
    distances = SelfDistances(spheres.points(robot), panda_self_pairs(), spheres.radii)
    return float(jax.jit(lambda q: jax.vmap(lambda q: distances(q).min())(q).min())(q[::20]))


def test_the_skill_alone_goes_through_itself_and_the_whole_arm_does_not(robot, runs):
    _, _, alone, whole = runs
    assert least_distance(robot, alone.q) < -0.02
    assert least_distance(robot, whole.q) > 0
    hand = jax.vmap(lambda q: forward_kinematics(robot, q, "panda_hand")[:3, 3])(whole.q[::100])
    assert np.linalg.norm(hand[-1] - INTO_THE_BASE[0]) < 0.8 * np.linalg.norm(hand[0] - INTO_THE_BASE[0])


def test_joints_stay_below_their_velocity_limits(robot, runs):
    _, _, alone, whole = runs
    assert (np.abs(alone.qd) > robot.velocity_limit).any()
    assert (np.abs(whole.qd) < robot.velocity_limit).all()


def test_the_whole_arm_is_certified_and_its_energy_falls(runs):
    policy, _, _, whole = runs
    found = jax.jit(certificate)(policy.tree(jnp.eye(4), World()), START, jnp.zeros(7))
    assert not found.voided_by
    energy = np.asarray(whole.energy)
    assert np.diff(energy).max() < 1e-3 * (energy[0] - energy[-1])


def test_a_leaf_is_there_only_for_what_there_is(robot, runs):
    policy, own, _, _ = runs
    names = {leaf.name for leaf in policy.tree(jnp.eye(4), World()).leaves()} - {leaf.name for leaf in own.leaves()}
    assert names == {"hand_orientation", "self_collision", "joint_velocity_limit"}
    pole = World(capsules=Capsules.of([((0.5, 0.3, 0.0), (0.5, 0.3, 0.5), 0.05)]))
    assert "collision_avoidance" in {leaf.name for leaf in policy.tree(jnp.eye(4), pole).leaves()}
