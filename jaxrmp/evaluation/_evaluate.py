"""Rolls a skill out from many starts, on all devices and processes there are, and judges every end."""

import contextlib
import os
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from .._errors import ConfigurationError, NoGeometryError
from .._tree import Node, on_coordinates
from ..kinematics import ControlPoints, Robot
from ..learning import Skill
from ..policies import whole_arm_policy
from ..simulation import End, Engine, Outcomes, Problem, StopCriteria, largest_batch, simulate
from ..world import SelfDistances, World, own_self_pairs, own_spheres
from ._distribution import map_over_processes
from ._ends import Ends, classify_ends, control_point_errors
from ._finished import Finished
from ._stability import CertificateWatch


class Evaluation(NamedTuple):
    """What came of N `starts` [N, n]: how each ended (`outcomes`, `ends`), how far the hand was at the start
    (`start_error` [N], as `Ends.error`; `start_hand` [N, 3], its first control point in the world, m), and the
    certificate on the way (`residual`, `growth` [N], `uncertified` leaves). `engine`, `dt`, `batch` and `criteria` say
    how."""

    starts: np.ndarray
    outcomes: Outcomes
    ends: Ends
    start_error: np.ndarray
    start_hand: np.ndarray
    residual: np.ndarray
    growth: np.ndarray
    uncertified: tuple[str, ...]
    engine: str
    dt: float
    batch: int
    criteria: StopCriteria

    @property
    def seconds(self) -> np.ndarray:
        """How long each rollout took, s, [N]."""
        return np.asarray(self.outcomes.track.steps) * self.dt

    @property
    def energy_increase(self) -> np.ndarray:
        """The largest rise of V above its least value before, relative to V's range, of each rollout [N].

        A rollout that diverged counts as infinite.
        """
        track = self.outcomes.track
        span = np.maximum(track.energy.astype(float) - track.least, 1e-6 * np.maximum(np.abs(track.energy), 1e-6))
        return np.where(self.ends.kind == End.DIVERGED, np.inf, track.rise / span)

    @property
    def failing(self) -> np.ndarray:
        """Indices of the starts that neither converged nor stopped at a joint limit."""
        return np.flatnonzero(~np.isin(self.ends.kind, (End.CONVERGED, End.STOPPED_AT_LIMIT)))


def skill_problem(skill: Skill, robot: Robot, *, tree: Node | None = None, distances: tuple = ()) -> Problem:
    """What `evaluate` rolls out: the whole arm's policy, and the arm's distances to itself, where it has geometry.

    **Arguments**: `skill`; `robot`, that it was learned on; `tree`, by default that of `policies.whole_arm_policy`
    without obstacles; `distances`, further ones to watch, such as to a scene.
    """
    with contextlib.suppress(NoGeometryError):  # which the policy tells
        spheres = own_spheres(robot)
        if pairs := own_self_pairs(robot, spheres):
            distances = (SelfDistances(spheres.points(robot), pairs, spheres.radii), *distances)
    hand = ControlPoints(robot, skill.frames, skill.offsets)
    tree = tree or whole_arm_policy(skill, robot).tree(skill.T_world_object, World())
    return Problem(tree, skill.task_map(robot), hand, robot.lower, robot.upper, tuple(distances))


def limit_leaf(skill: Skill, robot: Robot) -> Node | None:
    """The joint limits of `skill` as a node on the joint space of `robot`, None if no joint has limits."""
    if skill.joint_limit is None:
        return None
    return on_coordinates(skill.limited, robot.num_joints, skill.joint_limit)


def evaluate(
    engine: Engine,
    problem: Problem,
    limits: Node | None,
    starts: np.ndarray,
    *,
    batch: int = 1024,
    progress: Callable[[int, int], None] | None = None,
    keep: str | os.PathLike | None = None,
) -> Evaluation:
    """Roll out from every start, find out how each ends, and evaluate the certificate on the way.

    **Arguments**: `engine`, what moves the joints; `problem`, what it rolls out; `limits`, see `classify_ends`;
    `starts` [N, n]; `batch`, starts at a time, halved until a call fits into memory; `progress`, called with how many
    starts of this process have ended, and how many it has; `keep`, a file in which starts that have ended are kept
    until all have, and from which an evaluation that was cut short goes on, None for none (each of several processes
    adds its number to the name).
    **Raises** what `simulate` and `largest_batch` raise, `ConfigurationError` for a file of another evaluation.
    """
    starts = np.asarray(starts, np.float32)
    if batch < 1:
        raise ConfigurationError(f"batch is {batch}, expected at least 1.")
    # No larger than the starts fill, so that what is measured is what is run; of few sizes, which are compiled once.
    batch = largest_batch(engine, min(batch, 1 << (len(starts) - 1).bit_length()))

    def work(own: np.ndarray) -> dict[str, Any]:
        several = jax.process_count() > 1
        path = keep and (f"{os.fspath(keep)}.{jax.process_index()}" if several else keep)
        finished = Finished(engine, problem, own, path)
        left = np.flatnonzero(~finished.done)
        watch, before = CertificateWatch(problem, len(left)), len(own) - len(left)

        def ended(rows: np.ndarray, last: Outcomes) -> None:
            finished.add(left[rows], last, watch.residual[rows], watch.growth[rows])

        def tell(count: int, _: int) -> None:
            if progress:
                progress(before + count, len(own))

        if len(left):
            tell(0, 0)
            try:
                simulate(engine, own[left], batch=batch, progress=tell, watch=watch, ended=ended)
            finally:
                finished.write()
        return finished.result()

    return _judged(engine, problem, limits, starts, batch, **map_over_processes(work, starts))


def _judged(
    engine: Engine,
    problem: Problem,
    limits: Node | None,
    starts: np.ndarray,
    batch: int,
    outcomes: Outcomes,
    **found: Any,
) -> Evaluation:
    """What came of rollouts, with the certificate's `residual` and `growth` that were found on the way."""
    _, hand, error = control_point_errors(problem, starts)
    return Evaluation(
        starts=starts,
        outcomes=outcomes,
        ends=classify_ends(problem, limits, outcomes),
        start_error=error,
        start_hand=hand,
        uncertified=CertificateWatch(problem, 0).uncertified,
        engine=engine.name,
        dt=engine.dt,
        batch=batch,
        criteria=engine.criteria,
        **found,
    )


class Replay(NamedTuple):
    """One rollout again, as it went: `time` [T] s, `q`, `qd` [T, n], and the `evaluation` of that start alone."""

    time: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    evaluation: Evaluation


def replay(engine: Engine, problem: Problem, limits: Node | None, start: np.ndarray, *, batch: int = 16) -> Replay:
    """Roll out from one `start` [n] again and keep the way, a state every `engine.chunk` steps.

    `batch`, copies of it at a time, for engines that fill devices; the rest as `evaluate`.
    """
    states: list[tuple[int, np.ndarray, np.ndarray]] = [(0, np.asarray(start, np.float32), np.zeros(len(start)))]
    count = engine.devices.count
    batch = -(-batch // count) * count
    watch = CertificateWatch(problem, batch)

    def keep(places: np.ndarray, state: Any) -> None:
        for row in np.flatnonzero(places == 0):  # none once it has ended, though copies of it may be under way still
            states.append((int(state.track.steps[row]), state.q[row].copy(), state.qd[row].copy()))
            watch(places, state)

    padded = np.repeat(np.asarray(start, np.float32)[None], batch, axis=0)
    outcomes = simulate(engine, padded, batch=batch, watch=keep).take(np.arange(1))
    steps, q, qd = (np.array(column) for column in zip(*states, strict=True))
    found = {"residual": watch.residual[:1], "growth": watch.growth[:1]}
    evaluation = _judged(engine, problem, limits, padded[:1], batch, outcomes, **found)
    return Replay(steps * engine.dt, q, qd, evaluation)
