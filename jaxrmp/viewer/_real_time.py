"""Steps of a fixed length at the pace of the clock on the wall, with an account of whether they were taken in time."""

from collections import deque
from typing import NamedTuple

_WINDOW = 1.0  # seconds that rates are means over
_LATELY = 5.0  # seconds for which what was lost is told
_MOST = 0.25  # seconds that may be made up for at once; what is missing beyond counts as lost


class Rates(NamedTuple):
    """Means over the last second: `steps` and `frames` per second, `factor`, simulated seconds per second due; and
    `lost`, seconds that were given up in the last five because the steps took longer than their time."""

    steps: float
    frames: float
    factor: float
    lost: float


class RealTime:
    """How many steps of `dt` seconds are due at each look at the clock. All times in seconds.

    Time that was slept through, up to a quarter of a second, is made up for; beyond, it is given up and counted:
    `lost`, in all.
    """

    def __init__(self, dt: float, now: float):
        self.dt = dt
        self.lost = 0.0
        self._last, self._credit = now, 0.0
        self._history: deque[tuple[float, int, float]] = deque()
        self._losses: deque[tuple[float, float]] = deque()

    def due(self, now: float, speed: float) -> int:
        """Steps to take now, at `speed` simulated seconds per second; 0 pauses."""
        elapsed, self._last = now - self._last, now
        self._credit += elapsed * speed
        most = _MOST * max(speed, 1.0)
        if self._credit > most:
            self.lost += self._credit - most
            self._losses.append((now, self._credit - most))
            self._credit = most
        steps = int(self._credit / self.dt + 1e-9)
        self._credit -= steps * self.dt
        self._history.append((now, steps, elapsed * speed))
        while self._losses and now - self._losses[0][0] > _LATELY:
            self._losses.popleft()
        while now - self._history[0][0] > _WINDOW and len(self._history) > 1:
            self._history.popleft()
        return steps

    def rates(self) -> Rates:
        """How it has gone in the last second."""
        lost = sum(loss for _, loss in self._losses)
        if len(self._history) < 2:
            return Rates(0.0, 0.0, 1.0, lost)
        (start, *_), *rest = self._history
        span = rest[-1][0] - start
        taken, wanted = (sum(row[i] for row in rest) for i in (1, 2))
        factor = taken * self.dt / wanted if wanted > 0 else 1.0
        return Rates(taken / span, len(rest) / span, factor, lost)
