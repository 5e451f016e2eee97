"""Angles of revolute joints, counted through whole turns where a recorder cut them off."""

import numpy as np

from .._errors import DemonstrationError
from ._recorded_units import BEYOND_LIMITS, fastest_motion

_TURN = 2 * np.pi


def without_wraps(
    time: np.ndarray, q: np.ndarray, lower: float, upper: float, fastest: float, place: str, told: list[str]
) -> np.ndarray:
    """Angles `q` [T] with jumps of whole turns taken out, and said in `told`.

    A joint with limits, `lower` and `upper`, keeps a large step that it can do, within its speed `fastest`, rad/s.
    **Raises** `DemonstrationError` if a jump may be of one turn more or less.
    """
    steps, seconds = np.diff(q), np.diff(time)
    turns = np.round(steps / _TURN)
    if np.isfinite(lower) or np.isfinite(upper):
        turns[np.abs(steps) <= fastest_motion(fastest, turning=True) * seconds] = 0
    jumps = np.flatnonzero(turns)
    for i in jumps:
        rest = steps[i] - _TURN * turns[i]
        if abs(rest) > np.pi / 2:
            raise DemonstrationError(
                f"{place} jumps by {steps[i]:.3g} rad at sample {i + 1}, which is neither a motion nor a whole turn. "
                "Record it again, with more samples there, or leave the demonstration out."
            )
    if jumps.size:
        at = ", ".join(str(i + 1) for i in jumps[:5]) + (", ..." if jumps.size > 5 else "")
        told.append(f"{place} jumps by a turn at sample {at}: the angle is counted through.")
    return q - _TURN * np.concatenate([[0.0], np.cumsum(turns)])


def within_limits(q: np.ndarray, lower: float, upper: float, place: str, told: list[str]) -> np.ndarray:
    """Angles `q` [T] by as many turns less as brings them within the limits, said in `told`; or as they are."""
    if _inside(q, lower, upper):
        return q
    for turns in (-1, 1, -2, 2):
        if _inside(q + _TURN * turns, lower, upper):
            told.append(f"{place} is beyond its limits by whole turns: {turns} turns are added.")
            return q + _TURN * turns
    return q


def one_turn_for_all(
    paths: list[np.ndarray], lower: float, upper: float, places: list[str], told: list[str]
) -> list[np.ndarray]:
    """Angles `paths` of one joint in all demonstrations, by whole turns so that equal postures at the end are equal
    numbers; as few as can be are changed, within the limits, and named in `told`."""

    def towards(end: float) -> list[int]:
        needed = []
        for path in paths:
            n = round((end - path[-1]) / _TURN)
            is_same = abs(end - path[-1] - _TURN * n) < np.pi / 2
            needed.append(n if is_same and _inside(path + _TURN * n, lower, upper) else 0)
        return needed

    turns = min((towards(path[-1]) for path in paths), key=lambda turns: sum(n != 0 for n in turns))
    for n, place in zip(turns, places, strict=True):
        if n:
            told.append(f"{place} is {abs(n)} turns off the other demonstrations: {n} turns are added.")
    return [path + _TURN * n for n, path in zip(turns, paths, strict=True)]


def _inside(q: np.ndarray, lower: float, upper: float) -> bool:
    return bool(q.min() >= lower - BEYOND_LIMITS and q.max() <= upper + BEYOND_LIMITS)
