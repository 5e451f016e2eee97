"""Learns with each demonstration left out in turn, and reproduces the one left out: what a skill does between them."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from .._errors import DemonstrationError, FileWarning, JaxrmpError
from ..kinematics import Robot
from ._configuration import Configuration
from ._demonstrations import DemonstrationSet
from ._learn import learn, tell_pauses
from ._measures import mean_errors
from ._prepare import PreparedDemonstrations, about_middle, in_frame, prepare
from ._preprocessing import Preprocessed
from ._reproduce import reproduce, rollout_duration
from ._subtask_trajectories import SubtaskTrajectories

Errors = dict[str, Any]


class Fold(NamedTuple):
    """What came of learning without the demonstration `left_out`, an index: by which `method`; the errors of the one
    `held_out`, and in the mean of those learned from, `training`, both as in `Reproduction`. Where it `failed`, why, in
    words, in which demonstrations are numbered without the one left out; then errors are None, and `method` is empty.
    """

    left_out: int
    method: str
    held_out: Errors | None
    training: Errors | None
    failed: str = ""


class Validation(NamedTuple):
    """All `folds`, one for each demonstration. Means are over those that `passed`, None where none did."""

    folds: tuple[Fold, ...]

    @property
    def passed(self) -> int:
        """How many folds did not fail."""
        return sum(not fold.failed for fold in self.folds)

    @property
    def held_out(self) -> Errors | None:
        """The mean errors of demonstrations that were left out."""
        return _mean([fold.held_out for fold in self.folds if fold.held_out is not None])

    @property
    def training(self) -> Errors | None:
        """The mean errors of demonstrations that were learned from."""
        return _mean([fold.training for fold in self.folds if fold.training is not None])

    def as_dict(self) -> dict[str, Any]:
        """As plain data: what `learning_report.json` says."""
        folds = [{**fold._asdict(), "failed": fold.failed or None} for fold in self.folds]
        return {"folds": folds, "passed": self.passed, "held_out": self.held_out, "training": self.training}


def leave_one_out(demonstrations: DemonstrationSet) -> tuple[DemonstrationSet, ...]:
    """The sets with each of `demonstrations` left out in turn.

    **Raises** `DemonstrationError` for fewer than three.
    """
    if len(demonstrations) < 3:
        raise DemonstrationError(
            f"{demonstrations.source}: {len(demonstrations)} demonstrations, but to validate takes three at least: one "
            "is left out, and learning needs two. Record more, or learn without validation."
        )
    shown = tuple(demonstrations)
    return tuple(replace(demonstrations, demonstrations=shown[:k] + shown[k + 1 :]) for k in range(len(shown)))


def validate(
    configuration: Configuration,
    robot: Robot,
    demonstrations: DemonstrationSet,
    progress: Callable[[str, float], None] | None = None,
) -> Validation:
    """Learn with each demonstration left out in turn, and reproduce the one left out by the whole policy.

    Every fold is learned by `learn` with the same configuration, method and seed, and rolls out from the first
    configuration of the demonstration left out, with the object where it was then, to where that demonstration ended,
    as `reproduce` does. A fold that fails is reported with its reason. What files do not say is warned of once, not in
    every fold.

    **Arguments**: as `learn`. **Returns** a `Validation`.
    **Raises** `DemonstrationError` for fewer than three demonstrations, else what `prepare` raises.
    """
    progress = progress or (lambda step, fraction: None)
    sets = leave_one_out(demonstrations)
    prepared = prepare(configuration, robot, demonstrations)
    tell_pauses(configuration, demonstrations.source, prepared)
    duration = rollout_duration(configuration.policy, prepared)
    folds = []
    for k, others in enumerate(sets):
        name = f"fold {k + 1} of {len(sets)}"
        progress(name, 0.0)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FileWarning)
                learning = learn(configuration, robot, others, lambda _, share, name=name: progress(name, share))
            skill = learning.skill
            T = prepared.poses[k] if skill.configuration.object else np.asarray(skill.T_world_object, float)
            held_out = reproduce(skill, robot, _alone(prepared, k, T, skill.of_turn), duration=duration).mean
            training = (learning.reproduction or reproduce(skill, robot, learning.prepared, duration=duration)).mean
            folds.append(Fold(k, skill.method, held_out, training))
        except JaxrmpError as error:
            folds.append(Fold(k, "", None, None, str(error)))
    return Validation(tuple(folds))


def _alone(prepared: PreparedDemonstrations, k: int, T: np.ndarray, of_turn: bool) -> PreparedDemonstrations:
    """Demonstration `k` of those `prepared`, seen from the frame `T` [4, 4] of a skill that does not know it, `of_turn`
    alone or not."""
    before, subtasks, row = prepared.poses[k], prepared.subtasks, slice(k, k + 1)

    def seen(points: np.ndarray) -> np.ndarray:
        moved = in_frame(points @ before[:3, :3].T + before[:3, 3], T)
        return about_middle(moved) if of_turn else moved

    ways = (of[:, row] for of in (subtasks.positions, subtasks.directions, subtasks.velocities))
    ends = seen(subtasks.ends[row])
    return prepared._replace(
        joints=Preprocessed(*(part[row] for part in prepared.joints)),
        poses=T[None],
        points=(seen(prepared.points[k]),),
        subtasks=SubtaskTrajectories(*ways, targets=ends[0], ends=ends),
    )


def _mean(errors: Sequence[Errors]) -> Errors | None:
    return mean_errors(errors) if errors else None
