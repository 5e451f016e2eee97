"""Ways round: a ball straight on the way of a hand is passed, and what needs none is left as it is."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrmp import ConfigurationError, TaskMap, certificate, pullback, pytree, uncertified_leaves
from jaxrmp.kinematics import ControlPoints, forward_kinematics, panda
from jaxrmp.leaves import CruisingAttractor, Damping
from jaxrmp.policies import NOTHING as NO_LEAF
from jaxrmp.policies import HandGoal, detour, find_detour, reaching_policy, whole_arm_policy
from jaxrmp.simulation import rollout
from jaxrmp.world import ObstacleDistances, Spheres, World

START = jnp.array([0.3, -0.5, 0.0, -2.3, 0.0, 1.9, 0.8], jnp.float32)
TIP = np.array([0.0, 0.0, 0.1], np.float32)
CORNERS = np.array([[0.08, 0.0, 0.1], [-0.04, 0.07, 0.1], [-0.04, -0.07, 0.1]], np.float32)
SIZE, WAY = 0.14, 0.55  # m


@pytree
class Flat(TaskMap):
    """Points [K, 3] as one vector, over sqrt(K)."""

    points: Any

    def __call__(self, x):
        return self.points(x).reshape(-1) * 3**-0.5


@pytree
class StraightOn:
    """As a flow that straightens nothing: the whole hand cruises straight to where its corners are to be."""

    ends: Any  # [3, 3], m
    tip: Any  # [3], m
    R_object_hand: Any
    frames = ("panda_hand",)
    turned = True

    def hand(self, T_world_object):
        return "panda_hand", TIP, self.tip

    def tree(self, robot, T_world_object):
        goal = jnp.reshape(self.ends, -1) * 3**-0.5
        leaf = CruisingAttractor(goal, weight=15.0, speed=0.2, damping_rate=40.0)
        return pullback(Flat(ControlPoints(robot, "panda_hand", CORNERS)), leaf) + Damping(2e-3, 10.0)


@pytest.fixture(scope="module")
def robot():
    return panda()


@pytest.fixture(scope="module")
def case(robot):
    """The policy, and worlds with a ball on the straight way, [3] of them: straight on it, and beside."""
    T = np.asarray(forward_kinematics(robot, START, "panda_hand"), float)
    moved = WAY * T[:3, 2]  # fingers first
    ends = CORNERS @ T[:3, :3].T + T[:3, 3] + moved
    tip = T[:3, :3] @ TIP + T[:3, 3]
    task = StraightOn(ends.astype(np.float32), (tip + moved).astype(np.float32), T[:3, :3].astype(np.float32))
    beside = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.6, 0.0]])
    centers = jnp.asarray(tip + 0.4 * moved + beside, jnp.float32)
    worlds = jax.vmap(lambda c: World(spheres=Spheres(c[None], jnp.full(1, SIZE), jnp.ones(1, bool))))(centers)
    return whole_arm_policy(task, robot), worlds


@pytest.fixture(scope="module")
def found(case):
    policy, worlds = case
    return jax.jit(jax.vmap(lambda world: find_detour(policy, START, jnp.eye(4), world, duration=15.0)))(worlds)


def test_a_ball_straight_on_the_way_is_passed_untouched_with_falling_energy(robot, case, found):
    policy, worlds = case

    def run(world, aside):
        path = rollout(policy.leaning(aside).tree(jnp.eye(4), world), START, duration=15.0, dt=0.001)
        distances = ObstacleDistances(policy.spheres.points(robot), world, policy.spheres.radii)
        tip = ControlPoints(robot, "panda_hand", TIP[None])(path.q[-1])[0]
        left = jnp.linalg.norm(tip - policy.tasks[0].tip)
        return path.energy, left, jax.lax.map(lambda q: distances(q).min(), path.q[::20]).min()

    energy, left, clearance = map(np.asarray, jax.jit(jax.vmap(run))(worlds, found.aside))
    assert (left < 0.01).all() and (clearance > 0).all()
    assert (np.diff(energy.astype(float), axis=1).max(1) < 1e-3 * np.ptp(energy, axis=1)).all()


def test_what_is_not_in_the_way_is_left_as_it_is(found):
    strength = np.asarray(found.aside.strength)
    assert strength[2] == 0 and (strength[:2] > 0).any()
    assert (np.asarray(found.left) < 0.01).all() and (np.asarray(found.clearance) > 0).all()


def test_the_policy_with_a_way_round_stays_certified(case, found):
    policy, worlds = case
    world, aside = jax.tree.map(lambda a: a[0], (worlds, found.aside))
    tree = policy.leaning(aside).tree(jnp.eye(4), world)
    assert uncertified_leaves(tree) == () and "detour" in [leaf.name for leaf in tree.leaves()]
    with jax.enable_x64(True):
        wide = jax.tree.map(
            lambda a: jnp.asarray(a, float) if jnp.issubdtype(jnp.result_type(a), jnp.floating) else a, tree
        )
        q = np.asarray(START, float) + 0.2 * np.random.default_rng(0).normal(size=(50, 7))
        law = jax.jit(jax.vmap(lambda q: certificate(wide, q, 0.3 * jnp.ones(7))))(q)
        assert np.max(law.residual) < 1e-8 and (np.asarray(law.dissipation) > 0).all()


def test_nothing_leads_round_where_there_is_nothing_or_nobody_says_what_goes_where(robot, case, found):
    policy, worlds = case
    world, aside = jax.tree.map(lambda a: a[0], (worlds, found.aside))
    free = HandGoal(np.eye(4), "panda_hand", None)
    assert detour(robot, policy.tasks[0], jnp.eye(4), World(), aside) is NO_LEAF
    assert detour(robot, free, jnp.eye(4), world, aside) is NO_LEAF
    assert free.hand(jnp.eye(4)) is None
    frame, offset, goal = HandGoal(np.eye(4), "panda_hand").hand(jnp.eye(4).at[0, 3].set(0.5))
    assert frame == "panda_hand" and offset.tolist() == [0, 0, 0] and goal.tolist() == [0.5, 0, 0]


def test_a_look_ahead_needs_a_step_that_goes_ahead():
    policy = reaching_policy(panda(), "panda_hand", START, self_collision=False)
    for wrong in ({"dt": 0.0}, {"dt": np.nan}, {"duration": -1.0}, {"duration": np.inf}):
        with pytest.raises(ConfigurationError, match="expected seconds, 0 < dt <= duration"):
            find_detour(policy, START, np.eye(4), World(), **wrong)
