"""The learning report: what happened while a skill was learned, as plain data."""

from dataclasses import asdict
from typing import Any

from ._flow_training import FlowFit
from ._learn import Learning
from ._learn_paper import PaperLearning
from ._potential_choice import PotentialChoice, WidthTrial
from ._subtask_trajectories import end_spread
from ._validate import Validation


def learning_report(learning: Learning, validation: Validation | None = None) -> dict[str, Any]:
    """Everything worth knowing of `learning`, a `Learning`, as dictionaries, lists, numbers and strings, fit for JSON
    but for figures that do not exist, which are NaN.

    `method` and `why` it; of a flow its first and last loss and how much it stretches space on the demonstrations, else
    null. Per subtask, none for a flow: nominal demonstration, kernel width and all widths tried, solver status and
    objective, residual slope at the end before its correction, Hessian eigenvalues at the goal (1/m), share of samples
    that no metric can turn (beyond 90 degrees), basin, first and last loss. Of all demonstrations, how they agree
    (`families`), and how close the robot comes to itself (`own_clearance`). Of its `validation`, `Validation.as_dict`,
    null if there was none. Lengths in metres, times in seconds.
    """
    prepared, paper = learning.prepared, learning.paper
    spread = end_spread(prepared.points)
    subtasks = [] if paper is None else [_subtask(paper, k, name) for k, name in enumerate(learning.skill.subtasks)]
    demonstrations = [
        {**report._asdict(), "end_spread": [float(v) for v in spread[i]]}
        for i, report in enumerate(prepared.joints.reports)
    ]
    return {
        "skill": learning.skill.configuration.name,
        "source": learning.skill.source,
        "frame": prepared.frame,
        "method": learning.skill.method,
        "why": learning.why,
        "flow": None if learning.flow is None else _flow(learning.flow.fit),
        "subtasks": subtasks,
        "demonstrations": demonstrations,
        "families": {**asdict(learning.agreement), "text": str(learning.agreement)},
        "self_clearance": {**learning.clearance._asdict(), "text": str(learning.clearance)},
        "validation": None if validation is None else validation.as_dict(),
        "seconds": learning.seconds,
    }


def _subtask(paper: PaperLearning, k: int, name: str) -> dict[str, Any]:
    losses = paper.metric.losses[:, k]
    return {
        "name": name,
        "nominal_demonstration": paper.nominal[k],
        "potential": _potential(paper.potentials[k]),
        "metric": {
            "first_loss": float(losses[0]),
            "last_loss": float(losses[-1]),
            "losses": [float(v) for v in losses[:: max(len(losses) // 100, 1)]],
        },
    }


def _flow(fit: FlowFit) -> dict[str, Any]:
    return {
        "first_loss": float(fit.losses[0]),
        "last_loss": float(fit.losses[-100:].mean()),
        "losses": [float(v) for v in fit.losses[:: max(len(fit.losses) // 100, 1)]],
        "least_stretch": fit.stretch[0],
        "largest_stretch": fit.stretch[1],
    }


def _potential(choice: PotentialChoice) -> dict[str, Any]:
    fit = {name: value for name, value in choice.fit._asdict().items() if name != "potential"}
    fit["goal_hessian_eigenvalues"] = list(choice.fit.goal_hessian_eigenvalues)
    return {**fit, **_trial(choice.trial), "widths_tried": [_trial(t) for t in choice.trials]}


def _trial(trial: WidthTrial) -> dict[str, Any]:
    if trial.basin is None:
        return trial._asdict()
    points = [{"position": list(x), "share": share} for x, share in trial.basin.rest_points]
    return {**trial._asdict(), "basin": {**trial.basin._asdict(), "rest_points": points}}
