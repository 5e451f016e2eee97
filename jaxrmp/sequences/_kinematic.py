"""A sequence with joints that do exactly what its policies ask for."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from .._errors import ConfigurationError, ShapeError
from .._pytree import single
from .._task_map import check_rigid
from ..kinematics import Robot
from ..simulation import Motion
from ..world import World
from ._advance import Memory, advance, fail, left_state
from ._command import follow
from ._holding import told_why
from ._report import Book, SequenceOutcome
from ._sequence import GripperMove, Sequence

_LOOK = 10  # steps from one look at the guard to the next


class SequencePath(NamedTuple):
    """The way of a sequence: `time` [T], s; `q`, `qd` [T, n]; `state` [T], the number of the state at each; and its
    `outcome`."""

    time: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    state: np.ndarray
    outcome: SequenceOutcome


def roll_sequence(
    sequence: Sequence,
    robot: Robot,
    q: Any,
    T_world_object: Any = None,
    world: World | None = None,
    *,
    dt: float = 0.001,
    on_gripper: Callable[[GripperMove], None] | None = None,
) -> SequencePath:
    """Roll a `sequence` out from rest at `q` [n], without a break: velocities carry over from state to state. Nothing
    here looks whether something is touched: `run_sequence` does.

    **Arguments**: `robot`, whose policies they are; `T_world_object` [4, 4], where the object is, by default at the
    world's origin; `world`, what the policies are told to avoid, by default nothing; `dt`, s, of a step; guards are
    looked at every tenth. `on_gripper` is called with what the fingers are told: nothing else here moves them.
    **Returns** a `SequencePath`. **Raises** `ShapeError` for another `q`, `ConfigurationError` for another `dt`,
    `RigidTransformError` for an object's pose that is none.
    """
    q = np.asarray(q, np.float32)
    if q.shape != (robot.num_joints,):
        raise ShapeError(f"q has shape {q.shape}, expected ({robot.num_joints},).")
    if not 0 < dt < 1:
        raise ConfigurationError(f"dt is {dt!r}, expected seconds between 0 and 1.")
    T = np.eye(4) if T_world_object is None else np.asarray(check_rigid(T_world_object, "T_world_object"), float)
    world = single(world or World())
    policies = [jax.device_put(single(state.policy)) for state in sequence.states]
    motion, memory, book, step = Motion.at_rest(q), Memory(), Book(), 0
    samples = [(0.0, q, np.zeros_like(q), 0)]
    while not memory.ended:
        state, policy = sequence.states[memory.state], policies[memory.state]
        target = np.asarray(state.target(T), np.float32)
        motion, energies, asked = follow(policy, robot, state.aim, target, world, motion, np.float32(dt), _LOOK)
        step += _LOOK
        seen = asked.seen(step * dt)
        samples.append((seen.time, np.asarray(motion.q), np.asarray(motion.qd), memory.state))
        book = book._replace(energy=book.energy.seeing(energies))
        finite = np.isfinite(samples[-1][1]).all()
        ahead = advance(sequence, memory, seen) if finite else fail(memory, f"not finite after {seen.time:.2f} s")
        if finite and ahead.ended == "failed":
            ahead = told_why(ahead, state, seen, policy.tree(target, world), samples[-1][1])
        if on_gripper is not None and ahead.over is not None and memory.over is None and state.gripper is not None:
            on_gripper(state.gripper)
        if left_state(memory, ahead):
            book = book.turned(sequence, memory, ahead, seen, policy.tree(target, world))
        memory = ahead
    time, q, qd, states = (np.array(column) for column in zip(*samples, strict=True))
    return SequencePath(time, q, qd, states, book.outcome(memory, step * dt))
