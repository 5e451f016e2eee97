"""Many trials in native MuJoCo at 1 kHz, with one compiled call of the policy for all of them a millisecond."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, UnknownNameError
from .._tree import acceleration
from ..scenes import Scene
from ._live_trial import INTERFACES, LiveTrial
from ._tracker import TrackerSettings
from ._trials import Criteria, Run, Trial
from ._zero_order_hold import learned_forms, with_held


def run_trials(
    scene: Scene,
    policy: Any,
    trials: Sequence[Trial],
    *,
    criteria: Criteria | None = None,
    tracker: TrackerSettings | None = None,
    interface: str = "torque",
    learned_rate: float | None = None,
    seed: int = 0,
    first: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Run a policy in physics from many starts.

    Every millisecond: the object's pose from the tracker, joint accelerations from the policy, cut at the velocity
    limits, torques from them cut at the torque limits, one step of MuJoCo. Trials that are over drop out.

    **Arguments**: `policy`, a pytree with a method `tree(T_world_object, world)`, as `policies.ArmPolicy`; `criteria`,
    by default the drawer's; `tracker`, None if the object's true pose is known at all times; `interface`: "torque",
    computed torque; "velocity" or "position", the policy's accelerations integrated to commands that a loop of torques
    follows, as inside an arm; `learned_rate`, Hz, at which learned leaves are evaluated and held in between, None for
    every millisecond; `seed`, of the tracker's noise; `first`, the number of the first trial, so that a
    single one can be replayed with its own noise; `progress`, called with the share of simulated time.
    **Returns** a `Run`.
    **Raises** `ConfigurationError` for no trials, a start in collision, a door without `criteria.T_object_wrist`, or a
    rate that does not fit; `UnknownNameError` for another interface.
    """
    if interface not in INTERFACES:
        raise UnknownNameError("interface", interface, INTERFACES)
    if not trials:
        raise ConfigurationError("there are no trials to run: give at least one.")
    criteria = criteria or Criteria()
    if scene.name == "door" and criteria.T_object_wrist is None:
        raise ConfigurationError("scene 'door' needs criteria.T_object_wrist, the wrist's pose that counts as there.")
    dt = scene.model.opt.timestep
    every = 1 if learned_rate is None else round(1.0 / (learned_rate * dt)) if 0 < learned_rate <= 1.0 / dt else 0
    if every < 1:
        raise ConfigurationError(f"learned_rate is {learned_rate!r}, expected Hz, above 0 and at most {1 / dt:g}.")
    live = [LiveTrial(scene, trial, criteria, tracker, interface, (seed, first + k)) for k, trial in enumerate(trials)]
    worlds: Any = jax.tree.map(lambda *a: jnp.stack(a), *(_obstacles(trial) for trial in live))
    q, qd = (np.zeros((len(live), scene.robot.num_joints), np.float32) for _ in range(2))
    T = np.zeros((len(live), 4, 4), np.float32)
    forms: Any = None
    steps = round(criteria.limit / dt)
    for step in range(steps):
        under_way = [i for i, trial in enumerate(live) if trial.outcome is None]
        if not under_way:
            break
        for i in under_way:
            q[i], qd[i] = live[i].sense()
            T[i] = live[i].T_seen
        if learned_rate is None:
            qdd = _command(policy, T, worlds, q, qd)
        else:
            forms = _learned(policy, T, worlds, q, qd) if step % every == 0 else forms
            qdd = _command_held(policy, forms, T, worlds, q, qd)
        qdd = np.asarray(qdd, float)
        for i in under_way:
            live[i].act(qdd[i])
        if progress is not None and step % 100 == 0:
            progress(step / steps)
    return Run(scene, tuple(trials), tuple(t.outcome for t in live if t.outcome), tuple(t.trace() for t in live))


def _obstacles(trial: LiveTrial) -> Any:
    return jax.tree.map(lambda a: jnp.asarray(a, _single(a)), trial.scene.obstacles())


def _single(a: Any) -> Any:
    return jnp.float32 if jnp.issubdtype(jnp.asarray(a).dtype, jnp.floating) else None


@jax.jit
def _command(policy, T, worlds, q, qd):
    return jax.vmap(lambda T, world, q, qd: acceleration(policy.tree(T, world), q, qd))(T, worlds, q, qd)


@jax.jit
def _learned(policy, T, worlds, q, qd):
    return jax.vmap(lambda T, world, q, qd: learned_forms(policy.tree(T, world), q, qd))(T, worlds, q, qd)


@jax.jit
def _command_held(policy, forms, T, worlds, q, qd):
    return jax.vmap(lambda forms, T, world, q, qd: acceleration(with_held(policy.tree(T, world), forms), q, qd))(
        forms, T, worlds, q, qd
    )
