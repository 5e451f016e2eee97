"""A sequence in MuJoCo: one simulation from the first state to the last, in which nothing is reset between them."""

import warnings
from collections.abc import Callable, Collection
from typing import Any, NamedTuple

import jax
import numpy as np

from .._errors import ConfigurationError, UnknownNameError
from .._pytree import single
from ..scenes import Scene
from ..simulation import INTERFACES, End, Run, Tracker, Trial
from ..simulation._live_trial import DIVERGED, LiveTrial
from ._advance import Memory, advance, fail, left_state
from ._command import ask
from ._holding import told_why
from ._report import Book, SequenceOutcome
from ._sequence import GripperMove, Sequence

_LOOK = 10  # milliseconds from one look at the guard to the next


class SequenceRun(NamedTuple):
    """A sequence in a scene, trial after trial: `run`, what `visualization` draws and films, and the `outcomes`."""

    run: Run
    outcomes: tuple[SequenceOutcome, ...]

    @property
    def successes(self) -> int:
        """How many trials came through, with nothing touched that must not be."""
        return sum(outcome.success for outcome in self.outcomes)


def run_sequence(
    scene: Scene,
    sequence: Sequence,
    trials: Collection[Trial],
    *,
    tracker: Tracker | None = None,
    interface: str = "torque",
    seed: int = 0,
    first: int = 0,
    on_gripper: Callable[[GripperMove], None] | None = None,
    progress: Callable[[float], None] | None = None,
) -> SequenceRun:
    """Run a `sequence` in a `scene`'s physics from the starts of `trials`, as `simulation.run_trials` runs a policy.

    Each is one simulation at 1 kHz: the velocities of the arm, and the furniture as it stands, go from one state to the
    next. Guards are looked at every 10 ms, by the object's pose as the policies are told it. A trial ends where the
    sequence does, when something is touched that must not be, or diverged.

    **Arguments**: `tracker`, `interface`, `seed`, `first` and `progress` as there; `on_gripper`, called with what the
    fingers are told. Where the scene has a `scenes.Gripper`, they are driven; where it has none, a warning says once
    that nothing moves.
    **Returns** a `SequenceRun`.
    **Raises** `ConfigurationError` for no trials, a start in collision, a width that the fingers do not have, or a
    state relative to the object of a scene that has none; `UnknownNameError` for another interface.
    """
    UnknownNameError.check("interface", interface, INTERFACES)
    if not trials:
        raise ConfigurationError("there are no trials to run: give at least one.")
    _check(scene, sequence)
    policies = [jax.device_put(single(state.policy)) for state in sequence.states]
    outcomes, ends, traces = [], [], []
    for k, trial in enumerate(trials):
        live = LiveTrial(scene, trial, np.inf, tracker, interface, (seed, first + k))
        of_all = (lambda share, k=k: progress((k + share) / len(trials))) if progress is not None else None
        outcome, end = _run(live, sequence, policies, on_gripper, of_all)
        outcomes.append(outcome)
        ends.append(live.outcome(end)._replace(reason=outcome.reason))
        traces.append(live.trace())
    return SequenceRun(Run(scene, tuple(trials), tuple(ends), tuple(traces)), tuple(outcomes))


def _run(live: LiveTrial, sequence: Sequence, policies: list[Any], on_gripper, progress) -> tuple[SequenceOutcome, End]:
    scene = live.scene
    robot = scene.robot
    fast = DIVERGED * np.asarray(robot.velocity_limit)
    memory, book, step, end = Memory(), Book(), 0, End.UNFINISHED
    while not memory.ended:
        state, policy = sequence.states[memory.state], policies[memory.state]
        live.sense()
        q, qd = (np.asarray(part, np.float32) for part in live.state())
        target = np.asarray(state.target(live.T_seen), np.float32)
        asked = ask(policy, robot, state.aim, target, live.world, q, qd)
        book = book._replace(energy=book.energy.seeing(asked.energy))
        qdd = np.asarray(asked.qdd, float)
        if not np.isfinite(qdd).all() or (np.abs(qd) >= fast).any():
            ahead, end = fail(memory, f"diverged after {live.time:.2f} s in state {state.name!r}"), End.DIVERGED
        elif live.touched:
            ahead = fail(memory, f"touched in state {state.name!r}: {', '.join(live.touched)}")
            end = End.TOUCHED
        elif step == 0 or step % _LOOK:
            ahead = memory
        else:
            seen = asked.seen(live.time)
            ahead = advance(sequence, memory, seen)
            if ahead.ended == "failed":
                ahead = told_why(ahead, state, seen, policy.tree(target, live.world), q)
        if ahead.over is not None and memory.over is None and state.gripper is not None:
            if scene.gripper is not None:
                scene.move_gripper(live.data, state.gripper.width)
            if on_gripper is not None:
                on_gripper(state.gripper)
        if left_state(memory, ahead):
            book = book.turned(sequence, memory, ahead, asked.seen(live.time), policy.tree(target, live.world))
        if progress is not None and step % 100 == 0:
            progress(live.time / sequence.limit)
        memory = ahead  # the next policy acts from the next step on
        if memory.ended:
            break
        live.act(qdd)
        step += 1
    end = End.CONVERGED if memory.ended == "done" else end
    return book.outcome(memory, live.time), end


def _check(scene: Scene, sequence: Sequence) -> None:
    for state in sequence.states:
        if state.aim is not None:
            scene.robot.frame_index(state.aim.frame)
        if state.relative_to == "object" and not scene.object:
            raise ConfigurationError(
                f"state {state.name!r} is relative to the object, which scene {scene.name!r} does not have: make it "
                'relative to the "world".'
            )
        if state.gripper is not None and scene.gripper is not None:
            scene.gripper.control(state.gripper.width)
    if any(state.gripper is not None for state in sequence.states) and scene.gripper is None:
        warnings.warn(
            f"the gripper is told something, and nothing moves: scene {scene.name!r} holds the fingers.",
            UserWarning,
            stacklevel=3,
        )
