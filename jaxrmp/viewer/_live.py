"""The programs of the live arm: many steps of the policy as one call, and a look at what its leaves do."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._forms import NaturalForm, resolve
from .._linalg import length, matmul
from .._pytree import pytree, static
from .._task_map import pushforward
from .._tree import Batched, Node, pullback
from ..inspection import inspect
from ..kinematics import ControlPoints, frame_poses
from ..policies import goal_distance
from ..simulation import Motion, euler
from ..world import World, ignored_in
from ._push import Push
from ._switched import switched

STEP = 0.001
"""Seconds from one evaluation of the policy to the next: the live arm runs it at 1 kHz."""

_NOTHING, _LEAST_SHARE = 1e-4, 0.005  # rad/s^2, and a share, that are rounding


@pytree
class Situation:
    """All that a page can change; its numbers are parameters of the compiled programs.

    `policy`, with a `robot` and a method `tree(T_world_target, world)`, such as `policies.ArmPolicy`;
    `T_world_target` [4, 4], where the object or the goal is; `world`, the obstacles; `shares`, of the leaves' switches;
    `push`, at the hand.
    """

    policy: Any
    T_world_target: jax.Array
    world: World
    shares: jax.Array
    push: Push

    def tree(self, hand: str) -> Node:
        """The whole policy, its leaves switched, with the push at the origin of the frame `hand`."""
        own = switched(self.policy.tree(self.T_world_target, self.world), self.shares)
        return own + pullback(ControlPoints(self.policy.robot, (hand,)), Batched(self.push, shared=True))


@pytree
class Reading:
    """What a call of `advance` tells: `motion` at its end; `poses` [F, 4, 4] of the frames then; `energy` [2], before
    its first and before its last step; `dissipated` [2], how much of it the damping took up to its last step, and with
    that. Without a step, energies are NaN."""

    motion: Motion
    poses: jax.Array
    energy: jax.Array
    dissipated: jax.Array


@partial(jax.jit, static_argnames=("frames", "hand"))
def advance(situation: Situation, motion: Motion, steps: jax.Array, frames: tuple[str, ...], hand: str) -> Reading:
    """`steps` steps of semi-implicit Euler from a state; any number of them by one program."""
    tree = situation.tree(hand)

    def step(i, carried):
        motion, energy, dissipated = carried
        found = tree.measure(motion.q, motion.qd)
        energy = jnp.stack([jnp.where(i == 0, found.energy, energy[0]), found.energy])
        dissipated = jnp.stack([dissipated[1], dissipated[1] + STEP * found.dissipation])
        return euler(motion, resolve(found.form.dense()), STEP), energy, dissipated

    none = jnp.full(2, jnp.nan, motion.q.dtype), jnp.zeros(2, motion.q.dtype)
    end, energy, dissipated = jax.lax.fori_loop(0, steps, step, (motion, *none))
    return Reading(end, frame_poses(situation.policy.robot, end.q, frames), energy, dissipated)


@pytree
class Look:
    """What `examine` tells of each of S leaves: `share` [S] in the force at the joints; `gap` [S], the least distance
    to what it is about, m, infinite without. And `weight`, how heavy the hand is; `goal`, how far it is to the goal, m,
    NaN where the policy does not say, or takes no hand to a place; `ignored`, how many obstacles are not finite;
    `uncertified`, the names of leaves that have no certificate."""

    share: jax.Array
    gap: jax.Array
    weight: jax.Array
    goal: jax.Array
    ignored: jax.Array
    uncertified: tuple[str, ...] = static()


@partial(jax.jit, static_argnames=("hand", "leaves"))
def examine(situation: Situation, motion: Motion, hand: str, leaves: tuple[str, ...]) -> Look:
    """A look at what the `leaves` do at one state, points of a batched one as one. The hand's weight is the mean of the
    policy's metric seen from it, `(J M^-1 J^T)^-1`. Shares of forces that together could not move a joint by 1e-4
    rad/s^2, and those below half a percent, are rounding, and zero. A row for each point stays within the program:
    there can be ten thousand."""
    found = inspect(situation.tree(hand), motion.q, motion.qd)
    J = pushforward(ControlPoints(situation.policy.robot, (hand,)), motion.q, motion.qd).J[0]
    mobility = matmul(J, resolve(NaturalForm(J, jnp.broadcast_to(found.M.sum(0), (3, *found.M.shape[1:])))).T)
    index = {name: k for k, name in enumerate(leaves)}
    row = np.array([index.get(name, index.get(name.partition("[")[0], len(leaves))) for name in found.names])
    total = partial(jax.ops.segment_sum, segment_ids=row, num_segments=len(leaves) + 1)
    least = partial(jax.ops.segment_min, segment_ids=row, num_segments=len(leaves) + 1)
    share = total(found.force_share)[:-1]
    moves = length(found.f).sum() > _NOTHING * jnp.trace(found.M.sum(0)) / found.M.shape[-1]
    policy, T = situation.policy, situation.T_world_target
    goal = goal_distance(policy, motion.q, T) if _goes_somewhere(policy, T) else jnp.nan
    return Look(
        share=jnp.where(moves & ~(share < _LEAST_SHARE), share, 0),
        gap=least(jnp.where(jnp.isnan(found.gap), jnp.inf, found.gap))[:-1],
        weight=3 / jnp.trace(mobility),
        goal=jnp.asarray(goal, motion.q.dtype),
        ignored=ignored_in(situation),
        uncertified=tuple(dict.fromkeys(n for n, sure in zip(found.names, found.certified, strict=True) if not sure)),
    )


def _goes_somewhere(policy: Any, T_world_target: jax.Array) -> bool:
    """Whether a policy takes a hand to a place, and says so."""
    tasks = policy.with_targets(T_world_target) if hasattr(policy, "with_targets") else []
    return any(hasattr(task, "hand") and task.hand(at) is not None for task, at in tasks)
