"""The report of an evaluation, as the numbers that go into its JSON file and its page."""

from typing import Any

import jax
import numpy as np

from ..kinematics import Robot
from ..learning import Skill
from ..simulation import End, Problem
from ._evaluate import Evaluation
from ._regions import regions
from ._rest_points import rest_points
from ._stability import flow_metrics, goal_hessians, learned_metrics, stationary_points

_SHOWN = 1000  # failing starts that are listed one by one
_AROUND = 0.3  # m around the region of the hand in which stationary points are looked for

KINDS = {end: end.name.lower() for end in End if end not in (End.RUNNING, End.RESTING, End.TOUCHED)}
"""Names of the kinds of ends, as the report has them."""


def report(evaluation: Evaluation, skill: Skill, problem: Problem, *, stationary: bool = True) -> dict[str, Any]:
    """All numbers of an evaluation: shares of starts, largest values, rest points, regions, failing starts, stability.

    The certificate's largest values are NaN if one of them was, from `starts_not_a_number` starts.
    `max_energy_increase` is the largest rise of V above its least value before, relative to V's range on that rollout.
    **Arguments**: `evaluation`, by `evaluate`, of `problem`, the `skill`'s; `stationary`, whether to look for the
    potentials' stationary points, which takes some seconds.
    """
    kind, track = evaluation.ends.kind, evaluation.outcomes.track
    N = len(kind)
    kinematic = evaluation.engine == "kinematic"
    touched = track.clearance < 0 if kinematic else track.touched > 0
    watched = not kinematic or bool(np.isfinite(track.clearance).any())  # else the problem has no distances
    return {
        **_main_figures(evaluation, np.ones(N, bool)),
        "non_finite": int((kind == End.DIVERGED).sum()),
        "time_to_converge_s": _quantiles(evaluation.seconds[kind == End.CONVERGED]),
        "spurious_rest_points": rest_points(
            evaluation.outcomes.q, evaluation.ends.points, np.flatnonzero(kind == End.SPURIOUS), N
        ),
        "limit_stops": _limit_stops(evaluation),
        "min_clearance_m": float(track.clearance.min()),
        "starts_that_touched": int(touched.sum()) if watched else None,
        # Of these alone the certificate speaks.
        "without_touch": None if touched.all() else _main_figures(evaluation, ~touched),
        "min_limit_margin_rad": float(track.margin.min()),
        "starts_that_crossed_a_limit": int((track.margin < 0).sum()),
        "max_joint_speed_rad_s": float(track.speed.max()),
        "regions": _regions(evaluation),
        "failing": [
            {
                "start": i,
                "end": KINDS[End(int(kind[i]))],
                "error_m": float(evaluation.ends.error[i]),
                "seconds": float(evaluation.seconds[i]),
                "q_start": evaluation.starts[i].tolist(),
                "q_end": evaluation.outcomes.q[i].tolist(),
            }
            for i in evaluation.failing[:_SHOWN].tolist()
        ],
        "failing_starts": len(evaluation.failing),
        "stability": stability(evaluation, skill, problem, stationary=stationary),
    }


def stability(evaluation: Evaluation, skill: Skill, problem: Problem, *, stationary: bool = True) -> dict[str, Any]:
    """Metrics, Hessians, stationary points and the certificate; see `report`. Of a flow, one row, for the hand."""
    if skill.learned is None:  # by construction it rests at the goal alone, and a turn at half turns
        configurations = np.concatenate([evaluation.starts, evaluation.outcomes.q])[:8192]
        found = flow_metrics(skill, _robot_of(problem), configurations)
        return {"subtasks": [{"name": skill.parts[0], **found}], "certificate": _certificate(evaluation)}
    # Places of the control points [M, K, 3] all over the region of starts and ends, targets at zero.
    ends = evaluation.ends.points[:4096]
    begun = ends + (evaluation.start_hand - evaluation.ends.hand)[:4096, None]
    drawn = np.random.default_rng(0).uniform(begun.min(0), begun.max(0), (4096, *ends.shape[1:]))
    region = np.concatenate([ends, drawn])
    low, high = region.reshape(-1, 3).min(0) - _AROUND, region.reshape(-1, 3).max(0) + _AROUND
    found = zip(skill.subtasks, learned_metrics(skill.learned, region), goal_hessians(skill.learned), strict=True)
    subtasks: list[dict[str, Any]] = [{"name": name, "metric": metric, "goal": goal} for name, metric, goal in found]
    for k, subtask in enumerate(subtasks if stationary else ()):
        potential = jax.tree.map(lambda a, k=k: a[k], skill.learned.potential_of)
        subtask["stationary_points"] = stationary_points(potential, low, high)
    return {"subtasks": subtasks, "certificate": _certificate(evaluation)}


def _robot_of(problem: Problem) -> Robot:
    """The robot whose hand a problem follows."""
    hand: Any = problem.hand
    return hand.robot


def _certificate(evaluation: Evaluation) -> dict[str, Any]:
    return {
        "uncertified_leaves": list(evaluation.uncertified),
        "max_residual": float(evaluation.residual.max()),
        "max_growth_rate": float(evaluation.growth.max()),
        "starts_not_a_number": int(np.isnan(evaluation.residual + evaluation.growth).sum()),
        "max_energy_increase": float(evaluation.energy_increase.max()),
    }


def _main_figures(evaluation: Evaluation, members: np.ndarray) -> dict[str, Any]:
    """How those rollouts end for which `members` [N] holds, and how much energy they gained."""
    shares = {name: float((evaluation.ends.kind[members] == end).mean()) for end, name in KINDS.items()}
    rise = float(evaluation.energy_increase[members].max())
    return {"starts": int(members.sum()), **shares, "max_energy_increase": rise}


def _quantiles(values: np.ndarray) -> dict[str, float] | None:
    if not len(values):
        return None
    return {"median": float(np.median(values)), "p95": float(np.quantile(values, 0.95)), "max": float(values.max())}


def _limit_stops(evaluation: Evaluation) -> list[dict[str, Any]]:
    """How many starts each joint limit stopped, and how far from the goal."""
    stopped = np.flatnonzero(evaluation.ends.kind == End.STOPPED_AT_LIMIT)
    joint = np.abs(evaluation.ends.limit_force[stopped]).argmax(1)
    found = []
    for j in np.unique(joint):
        at = stopped[joint == j]
        found.append(
            {
                "joint": int(j),
                "share": len(at) / len(evaluation.starts),
                "max_margin_rad": float(evaluation.ends.margin[at, j].max()),
                "median_error_m": float(np.median(evaluation.ends.error[at])),
                "starts": at[:20].tolist(),
            }
        )
    return found


def _regions(evaluation: Evaluation) -> list[dict[str, Any]]:
    found = []
    for name, members in regions(evaluation.start_hand, evaluation.start_error):
        times = _quantiles(evaluation.seconds[members & (evaluation.ends.kind == End.CONVERGED)])
        least = float(evaluation.outcomes.track.clearance[members].min())
        figures = _main_figures(evaluation, members)
        found.append({"region": name, **figures, "time_to_converge_s": times, "min_clearance_m": least})
    return found
