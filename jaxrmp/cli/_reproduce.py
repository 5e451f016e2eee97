"""`jaxrmp reproduce`: roll a skill out from each demonstration's start and measure it."""

import argparse
from typing import Any

import jax
import numpy as np

from .._errors import ConfigurationError
from ..learning import Reproduction, Skill, prepare, reproduce
from ..simulation import Rollout, arrival
from ..visualization import save_reproduction_figures
from ..xla import quickly
from ._optional import require
from ._output import error_table, made_by, progress_bar, write_arrays, write_json
from ._sources import demonstrations_of, skill_and_robot


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    duration = arguments.duration
    if not 0 < arguments.dt <= (arguments.dt if duration is None else duration) < float("inf"):
        raise ConfigurationError(f"--dt {arguments.dt} and --duration {duration}: expected 0 < dt <= duration.")
    if arguments.figures:
        require("plots")
    skill, robot = skill_and_robot(arguments.skill, arguments.robot)
    demonstrations = demonstrations_of(skill, arguments.demos, robot)
    with progress_bar(arguments.quiet) as progress:
        progress("preparing", 0.0)
        prepared = prepare(skill.configuration, robot, demonstrations)
        progress("reproducing", 0.3)
        times = {"duration": duration, "dt": arguments.dt}
        reproduction = reproduce(skill, robot, prepared, own_targets=arguments.targets == "own", **times)
        result = result_dict(reproduction, skill, demonstrations.source)
        if arguments.json:
            write_json(result, arguments.json)
        if arguments.save:
            rows = [(name, i) for i in range(len(reproduction.errors)) for name in ("time", "q", "qd")]
            arrays = {f"{name}_{i}": getattr(reproduction.rollouts, name)[i] for name, i in rows}
            write_arrays(arrays, arguments.save)
        if arguments.figures:
            progress("drawing", 0.8)
            made = made_by("reproduce", skill.configuration, demonstrations.source)
            write_json(made, arguments.figures / "made_by.json")
            save_reproduction_figures(prepared, reproduction, arguments.figures)
    print(error_table(result))


@quickly
def _missed(rollouts: Rollout) -> jax.Array:
    return jax.vmap(arrival)(rollouts).out_of_reach


def result_dict(reproduction: Reproduction, skill: Skill, measured_on: str) -> dict[str, Any]:
    """Errors per demonstration and in the mean, and which demonstrations they are about, as written by --json.

    `rests_away_from` names, for each demonstration, the `Skill.parts` that came to rest more than 1 cm from their goal.
    """
    missed = [[skill.parts[k] for k in np.flatnonzero(row)] for row in np.asarray(_missed(reproduction.rollouts))]
    per_demo = [
        {"demo": i, **errors, "rests_away_from": names}
        for i, (errors, names) in enumerate(zip(reproduction.errors, missed, strict=True))
    ]
    return {"learned_from": skill.source, "measured_on": measured_on, "per_demo": per_demo, "mean": reproduction.mean}
