"""`jaxrmp reproduce`: roll a skill out from each demonstration's start and measure it."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import ConfigurationError
from .._files import atomic_write
from ..learning import Reproduction, load_skill, prepare, reproduce
from ..visualization import save_reproduction_figures
from ._output import error_table, write_json
from ._sources import find_demonstrations, robot_of


def add_parser(commands) -> None:
    parser = commands.add_parser(
        "reproduce",
        help="roll a skill out from each demonstration's start and measure it",
        description="Kinematic rollouts of the whole policy from each demonstration's first configuration, compared "
        "with that demonstration: DTW, discrete Frechet and final distance of control points in the object's frame.",
        epilog="example: jaxrmp reproduce out/drawer_closing/drawer_closing.skill.npz --json errors.json",
    )
    parser.add_argument("skill", metavar="SKILL", help="skill file written by jaxrmp learn")
    parser.add_argument("--demos", metavar="DIR", help="demonstrations, or synthetic:TASK; default as in jaxrmp learn")
    parser.add_argument("--robot", metavar="FILE", help="robot file, if it is no longer where the skill was learned")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the errors as JSON")
    parser.add_argument("--save", metavar="FILE", type=Path, help="write the rollouts as NPZ: time_K, q_K, qd_K")
    parser.add_argument("--figures", metavar="DIR", type=Path, help="draw the reproductions")
    parser.add_argument(
        "--targets",
        choices=("own", "skill"),
        default="own",
        help="where the subtasks end: where each demonstration ended (default), or the skill's mean",
    )
    parser.add_argument("--duration", metavar="S", type=float, default=20.0, help="seconds of rollout, default 20")
    parser.add_argument("--dt", metavar="S", type=float, default=0.005, help="seconds a step, default 0.005")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    if not 0 < arguments.dt <= arguments.duration < float("inf"):
        raise ConfigurationError(
            f"--dt {arguments.dt} and --duration {arguments.duration}: expected 0 < dt <= duration."
        )
    skill = load_skill(arguments.skill)
    configuration = skill.configuration
    if arguments.robot:
        configuration = replace(configuration, robot=arguments.robot)
    robot = robot_of(configuration)
    skill.check_robot(robot)
    prepared = prepare(configuration, robot, find_demonstrations(arguments.demos, configuration.name))
    reproduction = reproduce(
        skill,
        robot,
        prepared,
        duration=arguments.duration,
        dt=arguments.dt,
        own_targets=arguments.targets == "own",
    )
    result = result_dict(reproduction)
    if arguments.json:
        write_json(result, arguments.json)
    if arguments.save:
        save_rollouts(reproduction, arguments.save)
    if arguments.figures:
        save_reproduction_figures(prepared, reproduction, arguments.figures)
    print(error_table(result["per_demo"], result["mean"]))


def result_dict(reproduction: Reproduction) -> dict[str, Any]:
    """Errors per demonstration and in the mean, as written by --json."""
    per_demo = [{"demo": i, **errors} for i, errors in enumerate(reproduction.errors)]
    return {"per_demo": per_demo, "mean": reproduction.mean}


def save_rollouts(reproduction: Reproduction, path: Path) -> None:
    """Write `time_K` [T], `q_K` and `qd_K` [T, n] of every demonstration K to one NPZ file."""
    arrays = {}
    for i in range(len(reproduction.errors)):
        rollouts = reproduction.rollouts
        arrays |= {f"time_{i}": rollouts.time[i], f"q_{i}": rollouts.q[i], f"qd_{i}": rollouts.qd[i]}
    with atomic_write(path) as file:
        np.savez_compressed(file, **arrays)
