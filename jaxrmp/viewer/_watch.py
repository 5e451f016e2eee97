"""Whether the energy falls as the certificate says, frame by frame."""

from typing import NamedTuple

import numpy as np

from ._live import Reading

_TOLERANCE = 1e-3  # of the energy's size, that single precision and steps of a millisecond may be off by in a frame


class Watched(NamedTuple):
    """`energy` V before a frame's last step; `allowed`, what it would be if exactly the dissipation had been taken from
    it since the last change from outside; `violations`, in how many frames so far V rose, or was not a number."""

    energy: float
    allowed: float
    violations: int


class EnergyWatch:
    """Follows V and what it may be.

    Between changes from outside (a moved goal, a switch, a pull at the arm, a reset), `dV/dt = -dissipation`: so
    `allowed` falls by what is dissipated, and V with it. A change moves both. V may not rise within a frame, by more
    than rounding; where it does, that is a violation: of a certificate that leaves without one void, or of a step too
    long for the policy.
    """

    def __init__(self):
        self._seen = Watched(float("nan"), float("nan"), 0)
        self._later = 0.0  # what the last step of the last frame took

    def see(self, reading: Reading, changed: bool, stepped: bool = True) -> Watched:
        """Take in a frame; `changed`, whether something from outside has changed since the last one; `stepped`, whether
        a step was taken in it."""
        if not stepped:
            return self._seen
        parts = (reading.energy, reading.dissipated)
        (start, end), (before_last, with_last) = (np.asarray(part, float) for part in parts)
        allowed = self._seen.allowed - self._later
        if changed or not np.isfinite([allowed, self._seen.energy]).all():
            allowed = start
        fell = end - start <= _TOLERANCE * (abs(start) + abs(end)) + 1e-6  # of what is not a number, it does not hold
        self._seen = Watched(end, allowed - before_last, self._seen.violations + int(not fell))
        self._later = with_last - before_last
        return self._seen
