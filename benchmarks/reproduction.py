"""How well demonstrations are reproduced, over seeds, beside the yardsticks known for the same recordings."""

import itertools
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from jaxrmp.kinematics import Robot
from jaxrmp.learning import (
    Configuration,
    PreparedDemonstrations,
    control_point_frames,
    control_points,
    in_frame,
    learn,
    prepare,
    reproduce,
    reproduction_errors,
)

from ._skills import recorded

SEEDS = range(5)
TASKS = ("drawer_closing", "door_reaching", "cup_round")


def rows() -> list[dict[str, Any]]:
    """One row a task and seed with its configuration, see `recorded`, then what the same measures say of others.

    The yardsticks are the reproductions that the paper's authors logged, where $JAXRMP_DATA has them, and the mean
    distance from one demonstration to another.
    """
    found: list[dict[str, Any]] = []
    for task in TASKS if os.environ.get("JAXRMP_DATA") else TASKS[:2]:  # nobody scripted the third
        configuration, demonstrations = recorded(task)
        robot = configuration.load_robot()
        for seed in SEEDS:
            learning = learn(replace(configuration, seed=seed), robot, demonstrations)
            result = reproduce(learning.skill, robot, learning.prepared)
            worst = max(e["goal_cm"] for e in result.errors)
            margin = min(e["limit_margin_rad"] for e in result.errors)
            found.append(
                {**_row(task, f"seed {seed}", result.errors), "worst_goal_cm": worst, "limit_margin_rad": margin}
            )
        prepared = prepare(configuration, robot, demonstrations)
        logged = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "franka" / "reference_rollouts" / f"{task}.npz"
        if logged.is_file():
            found.append(_row(task, "authors, logged", _authors_errors(logged, configuration, robot, prepared)))
        pairs = itertools.permutations(range(len(prepared.points)), 2)
        apart = [reproduction_errors(prepared.points[i], prepared.points[j]) for i, j in pairs]
        found.append({**_row(task, "human to human", apart), "goal_cm": None})
    return found


def _authors_errors(
    file: Path, configuration: Configuration, robot: Robot, prepared: PreparedDemonstrations
) -> list[dict]:
    frames, offsets = control_point_frames(configuration)
    errors = []
    with np.load(file) as logged:
        for i, (demonstrated, T) in enumerate(zip(prepared.points, prepared.poses, strict=True)):
            points = control_points(robot, frames, offsets, logged[f"joint_positions_{i}"])
            errors.append(reproduction_errors(demonstrated, in_frame(points, T)))
    return errors


def _row(task: str, source: str, errors: Sequence[dict[str, float]]) -> dict[str, Any]:
    mean = {name: float(np.mean([e[name] for e in errors])) for name in ("dtw_cm", "frechet_cm", "goal_cm")}
    return {"name": task, "source": source, **mean}
