"""What the machinery of `jaxrmp.xla` gains, by turns with the mathematics as written: policies and steps in batches."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp import compiled
from jaxrmp.evaluation import sample_starts, skill_problem
from jaxrmp.learning import load_skill
from jaxrmp.simulation import KinematicEngine, StopCriteria
from jaxrmp.xla import in_lanes, machinery

from ._policies import Policy, on_device, panda_24_pairs, states
from ._skills import skill_file
from ._timing import alternately, ratio

BATCHES = (1, 4, 16, 64, 128, 256, 1024)


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One row a batch, in float32: the policy of 24 pairs, where a batch of 1 is a call by `compiled`; the same written
    in C, `in_lanes`; and a step of the kinematic engine (policy, energy, judge) with the skill of the drawer.

    `us_per_evaluation` with the machinery, `as_written_us` without; `times_as_written`, how many times as long the one
    takes as the other: the median over turns, each against its neighbour. It should nowhere be above one.
    """
    policy, found = panda_24_pairs(), []
    for batch in BATCHES[:2] if quick else BATCHES:
        calls = {}
        for name, on in (("on", True), ("off", False)):
            with machinery(on):
                calls[name] = _call(policy, batch)
        found.append(_row("panda_24_pairs", batch, calls, batch, quick))
        if batch > 1:
            found.append(
                _row("panda_24_pairs, in lanes", batch, calls | {"on": _call(policy, batch, True)}, batch, quick)
            )
    for batch in () if quick else (256, 1024):
        calls = {}
        for name, on in (("on", True), ("off", False)):
            with machinery(on):
                calls[name] = _steps(batch)
        found.append(_row("kinematic step of a skill", batch, calls, batch * _CHUNK, quick))
    return found


_CHUNK = 50  # steps of a call


def _row(name: str, batch: int, calls: dict[str, Callable[[], Any]], evaluations: int, quick: bool) -> dict[str, Any]:
    taken = alternately(calls, rounds=2 if quick else 31, least=0.0 if quick else 0.02)
    return {
        "name": name,
        "batch": batch,
        "us_per_evaluation": float(np.median(taken["on"])) / evaluations,
        "as_written_us": float(np.median(taken["off"])) / evaluations,
        "times_as_written": ratio(taken["on"], taken["off"]),
    }


def _steps(batch: int) -> Callable[[], Any]:
    """A chunk of steps of the kinematic engine, from starts all over the range of the joints."""
    skill = load_skill(skill_file("drawer_closing", "synthetic", method="paper"))
    problem = skill_problem(skill, skill.load_robot())
    engine = KinematicEngine(problem, StopCriteria(), chunk=_CHUNK)
    state = engine.advance(engine.begin(sample_starts(problem, batch)))
    return lambda: engine.advance(state)


def _call(policy: Policy, batch: int, lanes: bool = False) -> Callable[[], Any]:
    Q, QD = states(batch)
    if batch == 1:
        one = compiled(policy, policy.moving, Q[0], QD[0])
        return lambda: one(policy.moving, Q[0], QD[0])
    arguments = on_device(policy.moving), jnp.asarray(Q), jnp.asarray(QD)
    many = jax.jit(jax.vmap(in_lanes(policy) if lanes else policy, in_axes=(None, 0, 0))).lower(*arguments).compile()
    return lambda: many(*arguments).block_until_ready()
