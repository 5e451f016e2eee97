"""From paths of points alone, such as handwriting, to a policy: no robot, no subtasks, any unit of length."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial

from .._errors import ConfigurationError, DemonstrationError, FileWarning, TrainingError
from .._task_map import Translation, compose
from .._tree import Node, pullback
from ..leaves import CruisingAttractor
from ._arc_length import resample_by_arc_length
from ._configuration import FlowSettings
from ._families import Families, families
from ._flow_training import FlowFit, check_stretch, train_flow
from ._measures import discrete_frechet, dtw_distance
from ._reproduce import energy_increase, itself, rollouts_of

_EXTENT = 0.5  # m: the settings of a flow are made for paths as large as this
_TAPER = 0.06  # of the extent: within it the motion slows down
_DURATION = 5.0  # s, for the longest path, unless a speed is given
_DAMPING = 200.0  # over the time that the longest path takes: 40 1/s for 5 s
_STEPS = 1000  # in that time, of a reproduction, which lasts three times as long
_FAR, _BEYOND = 1500, 0.5  # places around the paths, and how far beyond them, of the extent
_CLOSED = 0.1  # of a path's own extent, between start and end
_CROSSES, _NEAR_GOAL, _COSINE = 0.02, 0.1, 0.5  # of the extent: so near ways cross, not at the goal, by 60 degrees
_LIFT = 0.7  # of the length left: the coordinate that tells apart where paths cross
_GOAL, _RISE = 0.01, 1e-3  # of the extent, and of V's range: what a reproduction may miss the goal by, and V rise by
_SAMPLES = 200  # of paths that are compared
_MEND = "Raise conditioning or lower learning_rate of the settings."


class PathLearning(NamedTuple):
    """A `policy` learned from N paths in R^m, in their units, with its only place of rest at the `goal` [m].

    Where paths cross or are tangled, the policy is one on R^(m + 1), with 0.7 of the length that is left as one more
    coordinate, which is `lift` [N] at their starts, else None; it rests where that is zero, too. `paths`, N arrays
    [T, m], their ends moved to the goal; `fit`, how the flow was trained; `reproductions` [N, S, m] of the paths at
    steps of `dt`, seconds, and their `errors`, for each a dict of `dtw`, `frechet` and `goal`, in the paths' units,
    and `energy_increase`, relative.
    """

    policy: Node
    goal: np.ndarray
    lift: np.ndarray | None
    paths: tuple[np.ndarray, ...]
    fit: FlowFit
    reproductions: np.ndarray
    dt: float
    errors: tuple[dict[str, float], ...]

    def start(self, x: np.ndarray) -> np.ndarray:
        """The policy's coordinates at places `x` [..., m] from which it begins: [..., m], or [..., m + 1] with the
        coordinate that the path has which starts nearest."""
        x = np.asarray(x, float)
        if self.lift is None:
            return x
        starts = np.stack([path[0] for path in self.paths])
        nearest = np.linalg.norm(x[..., None, :] - starts, axis=-1).argmin(-1)
        return np.concatenate([x, self.lift[nearest][..., None]], axis=-1)

    @property
    def mean(self) -> dict[str, float]:
        """The mean of each error over the paths."""
        return {name: float(np.mean([e[name] for e in self.errors])) for name in self.errors[0]}


def learn_paths(
    paths: Sequence[np.ndarray],
    settings: FlowSettings | None = None,
    *,
    speed: float | None = None,
    seed: int = 0,
    progress: Callable[[int, float], None] | None = None,
) -> PathLearning:
    """Learn a policy that goes where paths of a point go, to where they end, from everywhere.

    The ends are put together at their mean, the goal; one flow makes the paths straight, and behind it an attractor
    leads to the goal: `pullback(flow, CruisingAttractor)`, certified. The unit of length is the paths' own: lengths are
    divided by the extent of them all, so pixels, millimetres and metres give the same policy. So do all speeds, but for
    the time it takes: damping is in proportion.

    No stable policy of the place alone follows paths that cross, themselves or each other. They get one more
    coordinate, the length that is left, which tells the two times apart: `PathLearning.start` gives it. So do paths so
    tangled that a flow of the place alone would stretch space too much.

    **Arguments**: `paths`, one or more arrays [T, m], m of 2 or more, such as `load_paths` reads; `settings`, of the
    flow, whose lengths are for paths of half a metre; `speed`, units per second, by default such that the longest path
    takes 5 s; `seed`, of all that is random; `progress`, called with updates done and mean loss.
    **Returns** a `PathLearning`.
    **Raises** `DemonstrationError` for paths that are none or end where they began; `ConfigurationError` for a speed
    that is not positive; `TrainingError` for a flow that stretches space too much, or from which reproductions do not
    arrive or gain energy.
    **Warns** by a `FileWarning` of paths that cross, and that part, as `families` finds.

    >>> s = np.linspace(0, 1, 50)[:, None]
    >>> arc = np.hstack([300 * s, 80 * np.sin(3 * s)])  # pixels
    >>> found = learn_paths([arc, arc + [0, 9]], FlowSettings(updates=20, couplings=4))
    >>> found.goal.round(1).tolist()
    [300.0, 15.8]

    The flow: docs/concepts.md.
    """
    drawn = _checked(paths)
    goal = np.mean([path[-1] for path in drawn], axis=0)
    ended = tuple(path - path[-1] for path in drawn)
    targets = tuple(path + goal for path in ended)
    extent = float(np.linalg.norm(np.ptp(np.concatenate(ended), axis=0)))
    if speed is not None and not (0 < speed < np.inf):
        raise ConfigurationError(f"speed is {speed!r}, expected a positive number, units of the paths per second.")
    duration = _DURATION if speed is None else max(map(_length, ended)) / speed
    agreement = families([path[:, None] for path in ended])
    if not agreement.agree:
        warnings.warn(_disagreement(agreement), FileWarning, stacklevel=2)
    unit, lift = extent / _EXTENT, None

    def trained(ended: Sequence[np.ndarray]) -> FlowFit:
        far = _around(ended, extent) / unit
        fit = train_flow([path / unit for path in ended], far, settings, seed, progress)
        check_stretch(fit)
        return fit

    why, fit = _crossing(ended, goal, extent), None
    if not why:
        try:
            fit = trained(ended)
        except TrainingError as error:
            why = f"no flow of the place alone passes: {error}"
    if fit is None:
        warnings.warn(
            f"{why} The policy has one more coordinate, the length left. Begin from what `start` gives.",
            FileWarning,
            stacklevel=2,
        )
        lift = np.array([_LIFT * _length(path) for path in ended])
        even = [resample_by_arc_length(path, _SAMPLES) for path in ended]
        left = np.linspace(1, 0, _SAMPLES)
        ended = tuple(np.column_stack([path, top * left]) for path, top in zip(even, lift, strict=True))
        fit = trained(ended)
    fit = fit._replace(flow=replace(fit.flow, length=fit.flow.length * unit))
    gains = {"speed": max(map(_length, ended)) / duration, "damping_rate": _DAMPING / duration}
    attractor = CruisingAttractor(np.zeros(len(ended[0][0])), **gains, taper=_TAPER * extent, name="learned")
    origin = np.append(goal, np.zeros(len(ended[0][0]) - len(goal)))
    policy = pullback(compose(Translation(jnp.asarray(origin, jnp.float32)), fit.flow), attractor)
    starts = origin + np.stack([path[0] for path in ended])
    dt = duration / _STEPS
    rollouts = rollouts_of(Partial(itself, policy), (), starts, 3 * _STEPS * dt, dt)
    reproductions = np.asarray(rollouts.q, float)[..., : len(goal)]
    finite = np.isfinite(rollouts.q).all((1, 2))
    if not finite.all():
        raise TrainingError(f"reproductions of paths {np.flatnonzero(~finite).tolist()} are not finite. {_MEND}")
    errors = tuple(map(_errors, targets, reproductions, rollouts.energy))
    _check_reproductions(errors, extent)
    return PathLearning(policy, goal, lift, targets, fit, reproductions, dt, errors)


def _length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _checked(paths: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The paths as arrays of double precision, all of one dimension, that move."""
    if not len(paths):
        raise DemonstrationError("received no paths, expected at least one.")
    found = []
    for k, path in enumerate(paths):
        try:
            path = np.asarray(path, float)
        except (TypeError, ValueError) as error:
            raise DemonstrationError(f"path {k} is not an array of numbers: {error}.") from error
        if path.ndim != 2 or path.shape[0] < 2 or path.shape[1] < 2:
            raise DemonstrationError(f"path {k} has shape {path.shape}, expected [T, m], T and m of 2 or more.")
        if found and path.shape[1] != found[0].shape[1]:
            raise DemonstrationError(f"path {k} is in {path.shape[1]} dimensions, path 0 in {found[0].shape[1]}.")
        if (bad := np.flatnonzero(~np.isfinite(path).all(axis=1))).size:
            raise DemonstrationError(f"path {k} is not finite at sample {bad[0]}.")
        reach = np.linalg.norm(path - path[-1], axis=1)
        if reach[0] <= _CLOSED * reach.max():
            raise DemonstrationError(
                f"path {k} ends where it began, or does not move. A stable policy rests at its goal and cannot leave "
                "it, so none can follow that. Cut it into motions that end elsewhere."
            )
        found.append(path)
    return found


def _crossing(paths: Sequence[np.ndarray], goal: np.ndarray, extent: float) -> str:
    """Which two of `paths`, or one twice, cross where, at 60 degrees and more, away from `goal`; empty if none do."""
    even = np.stack([resample_by_arc_length(path, _SAMPLES // 2) for path in paths])
    along = even[:, 6:] - even[:, :-6]
    along = (along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-12 * extent)).reshape(
        -1, even.shape[-1]
    )
    x = even[:, 3:-3].reshape(along.shape)
    square = (x * x).sum(1)
    distance = np.sqrt(np.maximum(square[:, None] + square - 2 * x @ x.T, 0))
    away = square > (_NEAR_GOAL * extent) ** 2
    found = np.argwhere((distance < _CROSSES * extent) & (along @ along.T < _COSINE) & away & away[:, None])
    if not len(found):
        return ""
    i, j = found[0]
    samples = even.shape[1] - 6
    return (
        f"paths {i // samples} and {j // samples} cross near {(x[i] + goal).round(3).tolist()}, which no stable policy "
        "of the place alone can follow."
    )


def _disagreement(agreement: Families) -> str:
    """What disagrees, in shares of the paths' length, and what to do."""
    groups = " | ".join(", ".join(map(str, group)) for group in (*agreement.groups, *((k,) for k in agreement.odd)))
    far = agreement.parting[0]
    return (
        f"paths go several ways ({groups}): {far.first} and {far.second} part by {far.apart:.3g} at {far.at:.0%} of "
        "the way. One policy learns what lies between. Learn those that go one way apart."
    )


def _around(paths: Sequence[np.ndarray], extent: float) -> np.ndarray:
    """Places all over the box of `paths` and beyond it, [F, m]."""
    points = np.concatenate(paths)
    lower, upper = points.min(0) - _BEYOND * extent, points.max(0) + _BEYOND * extent
    return np.random.default_rng(0).uniform(lower, upper, (_FAR, len(lower)))


def _errors(path: np.ndarray, reproduced: np.ndarray, energy: np.ndarray) -> dict[str, float]:
    a, b = (resample_by_arc_length(x, _SAMPLES) for x in (path, reproduced))
    return {
        "dtw": dtw_distance(a, b),
        "frechet": discrete_frechet(a, b),
        "goal": float(np.linalg.norm(reproduced[-1] - path[-1])),
        "energy_increase": energy_increase(energy),
    }


def _check_reproductions(errors: Sequence[dict[str, float]], extent: float) -> None:
    """**Raises** `TrainingError` for a policy from which reproductions do not arrive, or gain energy."""
    goal, rise = (np.array([e[name] for e in errors]) for name in ("goal", "energy_increase"))
    if not (goal <= _GOAL * extent).all():
        missed = np.flatnonzero(~(goal <= _GOAL * extent)).tolist()
        raise TrainingError(
            f"reproduced, paths {missed} end up to {goal.max():.3g} from the goal, allowed {_GOAL * extent:.3g}. "
            + _MEND
        )
    if not (rise <= _RISE).all():
        raise TrainingError(
            f"the energy rises by {rise.max():.1e} of its range in a reproduction, allowed {_RISE}. {_MEND}"
        )
