"""Many trials in native MuJoCo at 1 kHz, judged by their scene's rules."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, UnknownNameError
from ..scenes import Scene
from ._judge import End, Seen, StopCriteria, Track, judge, margin
from ._live_trial import DIVERGED, INTERFACES, LiveTrial
from ._object_tracker import Tracker
from ._physical_arm import step_all
from ._step import command
from ._trials import Run, Trial
from ._zero_order_hold import learned_forms, with_held


def run_trials(
    scene: Scene,
    policy: Any,
    trials: Sequence[Trial],
    *,
    limit: float = 30.0,
    hold: float = 1.0,
    tracker: Tracker | None = None,
    interface: str = "torque",
    learned_rate: float | None = None,
    seed: int = 0,
    first: int = 0,
    aside: Any = None,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Run a policy in a `scene`'s physics from the starts of `trials`.

    Every millisecond: the object's pose from the tracker, joint accelerations from the policy, cut at the velocity
    limits, torques from them cut at the torque limits, one step of MuJoCo. Trials that are over drop out: at the
    scene's goal, which is looked at every 10 ms, when something is touched that must not be, diverged, or unfinished.

    **Arguments**: `policy`, a pytree with a method `tree(T_world_object, world)`, as `policies.ArmPolicy`; `limit`, s,
    that a trial may take; `hold`, s, for which the goal must be held; `tracker`, which alone tells the policy where the
    object is: a `TrackerSettings` or any other `Tracker`, None if its true pose is known at all times; `interface`:
    "torque", computed torque; "velocity" or "position", the policy's accelerations integrated to commands that a loop
    of torques follows, as inside an arm; `learned_rate`, Hz, at which learned leaves
    are evaluated and held in between, None for every millisecond; `seed`, of the tracker's chance; `first`, the number
    of the first trial, so that a single one can be replayed with its own noise; `aside`, what `policy.leaning` takes
    for each trial, stacked, such as ways round obstacles of `policies.find_detour`, None for the policy as it is;
    `progress`, called with the share of simulated time.
    **Returns** a `Run`.
    **Raises** `ConfigurationError` for no trials, a start in collision, a scene that lacks what its goal needs, or a
    time or rate that does not fit; `UnknownNameError` for another interface.
    """
    UnknownNameError.check("interface", interface, INTERFACES)
    if not trials:
        raise ConfigurationError("there are no trials to run: give at least one.")
    for name, value in (("limit", limit), ("hold", hold)):
        if not 0 < value < np.inf:
            raise ConfigurationError(f"{name} is {value!r}, expected a positive number.")
    scene.left(scene.fresh())  # says what the scene lacks, if anything
    dt = float(scene.model.opt.timestep)
    every = 1 if learned_rate is None else round(1.0 / (learned_rate * dt)) if 0 < learned_rate <= 1.0 / dt else 0
    if every < 1:
        raise ConfigurationError(f"learned_rate is {learned_rate!r}, expected Hz, above 0 and at most {1 / dt:g}.")
    live = [LiveTrial(scene, trial, hold, tracker, interface, (seed, first + k)) for k, trial in enumerate(trials)]
    worlds: Any = jax.tree.map(lambda *a: jnp.stack(a), *(trial.world for trial in live))
    fast = DIVERGED * np.asarray(scene.robot.velocity_limit, np.float32)
    criteria = StopCriteria(rest_seconds=np.inf, top_speed=fast, duration=limit)
    limits = np.asarray(scene.robot.lower, np.float32), np.asarray(scene.robot.upper, np.float32)
    q, qd = (np.array(part, np.float32) for part in zip(*(trial.state() for trial in live), strict=True))
    forms: Any = None

    def judge_and_command(track, q, qd):
        nonlocal forms, worlds
        if any(trial.obstacles_move for trial in live):
            worlds = jax.tree.map(lambda *a: np.stack(a), *(trial.world for trial in live))
        T = np.array([trial.T_seen for trial in live], np.float32)
        if learned_rate is not None and step % every == 0:
            forms = _learned(policy, aside, T, worlds, q, qd)
        ends = np.array([trial.there for trial in live]), np.array([bool(trial.touched) for trial in live])
        return _command(policy, aside, forms, T, worlds, q, qd, track, ends, criteria, limits, dt)

    track, step = Track.fresh(len(live)), 0
    while (track.status == End.RUNNING).any():
        track = step_all(live, track, q, qd, judge_and_command)
        if progress is not None and step % 100 == 0:
            progress(min(step * dt / limit, 1.0))
        step += 1
    outcomes = tuple(trial.outcome(End(int(end))) for trial, end in zip(live, track.status, strict=True))
    return Run(scene, tuple(trials), outcomes, tuple(trial.trace() for trial in live))


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0, 0, 0, 0, 0, 0, 0, None, None, None))
def _command(policy, aside, forms, T, world, q, qd, track, ends, criteria, limits, dt):
    tree = _leaning(policy, aside).tree(T, world)
    asked = command(tree if forms is None else with_held(tree, forms), q, qd)
    seen = Seen(q, qd, asked.energy, asked.qdd, margin(q, *limits), *ends)
    return asked.qdd, judge(criteria, dt, track, seen)


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0, 0, 0, 0))
def _learned(policy, aside, T, world, q, qd):
    return learned_forms(_leaning(policy, aside).tree(T, world), q, qd)


def _leaning(policy, aside):
    return policy if aside is None else policy.leaning(aside)
