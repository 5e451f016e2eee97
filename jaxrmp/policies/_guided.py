"""A policy that is drawn to a posture as strongly as to its targets.

Hand leaves alone are local: where the straight way of a hand leads through the arm itself, or past a joint limit, they
stop there. A posture that has the hands at their targets already is reached through joint space, where limits are no
walls on the way. All are leaves: potentials add up to one with its least at that posture, and the certificate holds.
"""

from dataclasses import replace
from typing import Any

from .._map_tree import map_tree
from .._tree import Leaf, Node
from ..kinematics import Robot
from ..leaves import CollisionAvoidance
from ._arm_policy import ArmPolicy
from ._distances import SELF_AVOIDANCE
from ._joints import posture

FIRM_SELF_AVOIDANCE = replace(SELF_AVOIDANCE, barrier=0.1, reach=0.01, floor=0.0005)
"""For an arm that a posture draws: felt within 1 cm, so that narrow ways and postures stay open, and too high to be
pressed through, which the pull of a posture can do to `SELF_AVOIDANCE`. At steps of 1 ms."""

FIRM_AVOIDANCE = replace(SELF_AVOIDANCE, barrier=0.05, reach=0.04, floor=0.001, name="collision_avoidance")
"""As `FIRM_SELF_AVOIDANCE`, but felt within 4 cm."""


def guide(robot: Robot, q: Any, **gains: Any) -> Node:
    """Draws a `robot` to the posture `q` [n], rad or m, as strongly as tasks do, such as one of `find_posture`.

    **Arguments**: `gains` of `Posture`, by default `weight=3`, `stiffness=20`, 1/s^2, and `damping_rate=9`, 1/s,
    critically damped. **Raises** as `posture`.
    """
    return posture(robot, q, **{"weight": 3.0, "stiffness": 20.0, "damping_rate": 9.0, "name": "guide", **gains})


def guided(policy: ArmPolicy, q: Any, **gains: Any) -> ArmPolicy:
    """The `policy` with a `guide` to `q`, which has its hands at their targets, and firmer avoidance.

    For `find_posture(...).q`, of the same targets and obstacles; works within `jax.jit` and `jax.vmap`.

    **Arguments**: `gains` as `guide`. **Raises** as `guide`.
    """
    always = map_tree(policy.always, _firm) + guide(policy.robot, q, **gains)
    return replace(policy, always=always, avoidance=FIRM_AVOIDANCE)


def _firm(leaf: Leaf) -> Leaf:
    own = isinstance(leaf, CollisionAvoidance) and leaf.name == SELF_AVOIDANCE.name
    return FIRM_SELF_AVOIDANCE if own else leaf
