"""Signs that a recording is not in radians, metres and seconds."""

import numpy as np

from .._errors import DemonstrationError

BEYOND_LIMITS = 0.2  # rad or m: recordings may sit a little outside a model's limits, degrees do not
_TURNS = 3  # from zero; two for an excursion
_WINDOW = 0.1  # s, over which a speed is taken
_TOO_FAST = 2.5  # times the velocity limit
_FASTEST_TURN, _FASTEST_SLIDE = 2 * np.pi, 5.0  # rad/s and m/s, of joints without velocity limits
_SLOWEST = 0.01  # rad/s or m/s: whole demonstrations below that have other stamps than seconds
_JUMP = 1.0  # rad or m, in one sample


def fastest_motion(limit: float, turning: bool) -> float:
    """What speed a recorded motion may have, rad/s or m/s, of a joint with a velocity `limit`, perhaps infinite."""
    return _TOO_FAST * (limit if np.isfinite(limit) else (_FASTEST_TURN if turning else _FASTEST_SLIDE) / _TOO_FAST)


def check_time(time: np.ndarray, q: np.ndarray, place: str) -> None:
    """**Raises** `DemonstrationError` if `time` [T] of joint positions `q` [T, n] is not in seconds."""
    steps = np.diff(time)
    ahead = steps > 0
    if not ahead.any() or np.ptp(q, axis=0).max() < BEYOND_LIMITS / 10:
        return
    step, lasts = float(np.median(steps[ahead])), float(time[-1] - time[0])
    speed = np.abs(np.diff(q, axis=0)[ahead]) / steps[ahead, None]
    is_slow = step >= 0.5 and np.percentile(speed, 95, axis=0).max() < _SLOWEST
    are_integers = step >= 1 and lasts >= 1000 and not (time % 1).any()
    if is_slow or are_integers:
        unit, factor = ("milliseconds", "1e3") if step < 500 else ("microseconds", "1e6")
        unit, factor = (unit, factor) if step < 5e5 else ("nanoseconds", "1e9")
        raise DemonstrationError(
            f"{place} lasts {lasts:.4g} s, {step:.3g} s from sample to sample, by its time stamps: they look like "
            f"{unit}. Divide them by {factor}, so that they are seconds."
        )


def check_angles(q: np.ndarray, lower: float, upper: float, place: str) -> None:
    """**Raises** `DemonstrationError` if angles `q` [T] are of several turns, which no limits allow."""
    largest = int(np.abs(q).argmax())
    many = abs(q[largest]) > 2 * np.pi * _TURNS
    if np.isfinite(lower) or np.isfinite(upper):
        if many:
            check_range(q, lower, upper, True, place)
    elif many or np.ptp(q) > 4 * np.pi:
        raise DemonstrationError(
            f"{place} is at {q[largest]:.4g} at sample {largest}, {abs(q[largest]) / (2 * np.pi):.3g} turns if that is "
            "radians. Are the recordings in degrees? Then say --units degrees (recording.units)."
        )


def check_range(q: np.ndarray, lower: float, upper: float, turning: bool, place: str) -> None:
    """**Raises** `DemonstrationError` if positions `q` [T] of a joint are far outside its limits."""
    beyond = np.maximum(lower - q, q - upper)
    worst = int(beyond.argmax())
    if beyond[worst] > BEYOND_LIMITS:
        unit, units, convert = (
            ("rad", "degrees", "say --units degrees, recording.units")
            if turning
            else ("m", "millimetres", "convert them: / 1000")
        )
        raise DemonstrationError(
            f"{place} is {beyond[worst]:.3g} {unit} outside its limits at sample {worst} ({q[worst]:.4g}, limits "
            f"{lower:.4g} to {upper:.4g}). Are the recordings in {units} (then {convert}), or of another "
            "robot?"
        )


def check_speed(time: np.ndarray, q: np.ndarray, limit: float, turning: bool, place: str, told: list[str]) -> None:
    """**Raises** `DemonstrationError` if positions `q` [T] of a joint move far faster than its velocity `limit`.

    If they do so for a moment only, that is said in `told`.
    """
    ahead = np.searchsorted(time, time + min(_WINDOW, (time[-1] - time[0]) / 4))
    ahead = np.maximum(ahead, np.arange(len(time)) + 1)
    rows = np.flatnonzero(ahead < len(time))
    if not rows.size:
        return
    ahead = ahead[rows]
    speed = np.abs(q[ahead] - q[rows]) / np.maximum(time[ahead] - time[rows], 1e-9)
    most = fastest_motion(limit, turning)
    over = np.flatnonzero(speed > most)
    if not over.size:
        return
    unit, units = ("rad", "degrees") if turning else ("m", "millimetres")
    step = int(np.abs(np.diff(q)).argmax())
    jump = q[step + 1] - q[step]
    if abs(jump) > _JUMP and over.size <= 2 * np.max(ahead - rows):
        raise DemonstrationError(
            f"{place} jumps by {jump:.3g} {unit} at sample {step + 1}, faster than it can move. Cut that out, or leave "
            "the demonstration out."
        )
    worst = int(speed.argmax())
    moves = f"{place} moves at {speed[worst]:.3g} {unit}/s at sample {rows[worst]}"
    known = f"its velocity limit is {limit:.3g}" if np.isfinite(limit) else f"more than {most:.3g} is taken for wrong"
    if over.size <= min(4 * np.max(ahead - rows), len(rows) / 4):
        told.append(f"{moves}; {known}. That is smoothed.")
        return
    raise DemonstrationError(
        f"{moves}; {known}. Are the recordings in {units}, or the time stamps not in seconds? Convert them to {unit} "
        "and s."
    )
