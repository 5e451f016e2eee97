"""Rolls a skill out from where each demonstration began, and measures how well it is reproduced."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from .._errors import RolloutError
from .._pytree import as_pytree, single
from .._tree import Node
from ..kinematics import Robot
from ..simulation import Rollout, rollout
from ._configuration import Configuration, PolicySettings
from ._measures import mean_errors, reproduction_errors, time_aligned_error, turn_errors
from ._prepare import PreparedDemonstrations, about_middle, control_points, in_frame
from ._skill import Skill

_IN_TIME = 501  # points of a demonstration that are compared at their times
_PLACES = ("dtw_cm", "frechet_cm", "goal_cm")


class Reproduction(NamedTuple):
    """Rollouts from each demonstration's first configuration and what they measure.

    `rollouts`, a `Rollout` with a leading axis of N; `points` [N, T, K, 3], the control points in the object's frame,
    m, of a turn alone about their middle; `errors`, for each demonstration a dict of `dtw_cm`, `frechet_cm`, `goal_cm`
    (see `reproduction_errors`), `position_percent`, `turn_deg`, `goal_turn_deg` (see `turn_errors`; None unless how the
    hand is turned was learned), all of places None where a turn alone was learned,
    `energy_increase`, the largest rise of V in one step relative to V's range, and `limit_margin_rad`, the smallest
    distance of any joint to its limits (negative if one was crossed), and `time_aligned_cm`, see
    `time_aligned_error`, of a skill of demonstrated tempo, pauses left out, else None.
    """

    rollouts: Rollout
    points: np.ndarray
    errors: tuple[dict[str, Any], ...]

    @property
    def mean(self) -> dict[str, Any]:
        """The mean of each error over the demonstrations, None where it was not measured."""
        return mean_errors(self.errors)


def reproduce(
    skill: Skill,
    robot: Robot,
    prepared: PreparedDemonstrations,
    *,
    duration: float | None = None,
    dt: float = 0.005,
    own_targets: bool = True,
) -> Reproduction:
    """Reproduce each demonstration from its own first configuration, at rest, with the object where it was then.

    **Arguments**: `skill`; its `robot`; `prepared`, the demonstrations, by `prepare`; `duration`, s, by default that
    of `rollout_duration`; `dt`, s; `own_targets`, whether targets are where that demonstration ended (so only the way
    there is judged) or the skill's.
    **Returns** a `Reproduction`.
    **Raises** `RolloutError` if a rollout holds non-finite states, `RobotError` for another robot than the skill's.
    """
    skill.check_robot(robot)
    seconds = rollout_duration(skill.configuration.policy, prepared) if duration is None else duration
    rollouts = rollouts_of(*_reproduced(skill, robot, prepared, own_targets), seconds, dt)
    finite = np.isfinite(rollouts.q).all((1, 2)) & np.isfinite(rollouts.qd).all((1, 2))
    if not finite.all():
        raise RolloutError(
            f"rollouts from demonstrations {np.flatnonzero(~finite).tolist()} became non-finite. Lower dt or the gains "
            f"(damping_rate * dt is {skill.damping_rate * dt:.2g}; above 1 Euler steps diverge)."
        )
    offsets = np.asarray(skill.offsets, float)
    as_fast = skill.configuration.policy.tempo == "demonstrated"
    times, ways = prepared.joints.in_time(_IN_TIME) if as_fast else (None, None)
    points, errors = [], []
    for i, (demonstrated, T) in enumerate(zip(prepared.points, prepared.poses, strict=True)):
        path = in_frame(control_points(robot, skill.frames, offsets, rollouts.q[i]), T)
        path = about_middle(path) if skill.of_turn else path
        points.append(path)
        late = None
        if times is not None and ways is not None and not skill.of_turn:
            then = in_frame(control_points(robot, skill.frames, offsets, ways[i]), T)
            late = time_aligned_error(times[i], then, rollouts.time[i], path)
        margin = np.minimum(rollouts.q[i] - np.asarray(robot.lower), np.asarray(robot.upper) - rollouts.q[i]).min()
        errors.append(
            {
                **_place_errors(skill, demonstrated, path),
                **_turn_errors(skill, robot, prepared.joints.q[i], rollouts.q[i]),
                "energy_increase": energy_increase(rollouts.energy[i]),
                "limit_margin_rad": float(margin),
                "time_aligned_cm": late,
            }
        )
    return Reproduction(rollouts, np.stack(points), tuple(errors))


def compile_ahead(
    skill: Skill, robot: Robot, prepared: PreparedDemonstrations, duration: float, dt: float = 0.005
) -> None:
    """Compile what `reproduce` runs, whose arguments these are; of the `skill` only the structure and shapes count."""
    _rollouts.lower(*_arguments(*_reproduced(skill, robot, prepared, True)), duration=duration, dt=dt).compile()


def _reproduced(
    skill: Skill, robot: Robot, prepared: PreparedDemonstrations, own_targets: bool
) -> tuple[Any, Any, Any]:
    """The arguments of `rollouts_of`."""
    ends = prepared.subtasks.ends if own_targets else np.broadcast_to(skill.targets, prepared.subtasks.ends.shape)
    # Its policy does not depend on these, which would make another program of each skill.
    bare = replace(skill, configuration=Configuration("any", skill.configuration.subtasks), source="any")
    policy = jax.tree_util.Partial(Skill.tree, bare, robot)
    return policy, (prepared.poses, ends), np.stack([q[0] for q in prepared.joints.q])


def _place_errors(skill: Skill, demonstrated: np.ndarray, rolled: np.ndarray) -> dict[str, float | None]:
    """What `reproduction_errors` measures of control points, None where the skill knows nothing of places."""
    if skill.of_turn:
        return dict.fromkeys(_PLACES)
    return {**reproduction_errors(demonstrated, rolled)}


def _turn_errors(skill: Skill, robot: Robot, demonstrated: np.ndarray, rolled: np.ndarray) -> dict[str, float | None]:
    """What `turn_errors` measures of joints [T, n] and [S, n], None where the skill knows nothing of turns."""
    if not skill.turned:
        return dict.fromkeys(("position_percent", "turn_deg", "goal_turn_deg"))
    assert skill.flow is not None  # of skills that turn
    corners = np.asarray(skill.flow.offsets, float)
    hands = (control_points(robot, skill.frames[:1] * 3, corners, q) for q in (demonstrated, rolled))
    return {**turn_errors(*(about_middle(hand) if skill.of_turn else hand for hand in hands))}


def rollout_duration(policy: PolicySettings, prepared: PreparedDemonstrations) -> float:
    """How long rollouts from where `prepared` demonstrations begin take to arrive, s, with much to spare."""
    if policy.tempo == "demonstrated":
        longest = max(time[-1] for time in prepared.joints.times)
    else:
        longest = max(np.linalg.norm(np.diff(x, axis=0), axis=-1).sum(0).max() for x in prepared.points) / policy.speed
    return float(max(20.0, 3 * longest))


def energy_increase(energy: np.ndarray) -> float:
    """The largest rise of V [T] in one step of a rollout, relative to its range; 0 where it has none."""
    energy = np.asarray(energy, float)
    span = np.ptp(energy)
    return float(max(np.diff(energy).max(), 0) / span) if span > 0 else 0.0


def rollouts_of(
    policy: Callable[..., Node], places: tuple[Any, ...], starts: np.ndarray, duration: float = 20.0, dt: float = 0.005
) -> Rollout:
    """Rollouts of N policies alike, each from one of `starts` [N, n] at rest, with a leading axis of N.

    **Arguments**: `policy`, from one of each of `places`, arrays [N, ...], to a node on joint space: a function, or a
    `jax.tree_util.Partial` of one with what all have in common, whose numbers are parameters of one compiled program.
    """
    return jax.tree.map(np.asarray, _rollouts(*_arguments(policy, places, starts), duration=duration, dt=dt))


def _arguments(policy: Callable[..., Node], places: tuple[Any, ...], starts: np.ndarray) -> tuple[Any, Any, Any]:
    return single(as_pytree(policy)), single(places), single(starts)


@partial(jax.jit, static_argnames=("duration", "dt"))
def _rollouts(policy, places, starts, *, duration: float, dt: float) -> Rollout:
    return jax.vmap(lambda place, q: rollout(policy(*place), q, duration=duration, dt=dt))(places, starts)


def itself(policy: Node) -> Node:
    """A policy that is the same everywhere, for `rollouts_of`."""
    return policy
