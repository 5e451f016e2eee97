"""When a policy is where: the latent attractor's way in time, laid along demonstrations as fast as they were."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

_SETTLE = 4.0  # over the damping rate: the shortest time that does not overshoot
_END = 1e-3  # m, of the way left when a demonstration ends
_STEP = 2e-3  # s, of the latent motion


class Tempo(NamedTuple):
    """Of an attractor behind a flow: its `speed`, m/s, and `settle`, s, in which what is left falls by e in the end."""

    speed: float
    settle: float

    @property
    def taper(self) -> float:
        """Of the attractor, m."""
        return self.speed * self.settle


def demonstrated_tempo(paths: Sequence[np.ndarray], times: Sequence[np.ndarray], damping_rate: float) -> Tempo:
    """The tempo with which the radius that is left is most like the length that is left, along `paths` [S, m], m, at
    `times` [S], s: so a flow stretches space least, in the mean square of the logarithm, over what moves."""
    speed = sum(_length(path)[-1] for path in paths) / sum(time[-1] for time in times)
    tempo = Tempo(float(speed), _SETTLE / damping_rate)
    logs = []
    for path, time in zip(paths, times, strict=True):
        length = _length(path)
        at = np.linspace(0, length[-1], 101)
        radius = np.interp(at, length, radii(time, tempo, damping_rate))
        logs.append(np.log(np.maximum(-np.diff(radius) / np.diff(at), 1e-9)))
    return tempo._replace(speed=tempo.speed * float(np.exp(-np.mean(logs))))


def radii(times: np.ndarray, tempo: Tempo, damping_rate: float) -> np.ndarray:
    """How far the latent motion is from its end [S], m, at `times` [S], s, from rest at the first, near 0 at the last.

    It is that of `CruisingAttractor`, of second order, `r'' = -damping_rate (speed tanh(r / taper) + r')`, from where
    it takes the whole time to come within 1 mm. What is then left is taken off evenly in time.
    """
    steps = max(round((times[-1] - times[0]) / _STEP), 1)
    dt, end = (times[-1] - times[0]) / steps, _END / tempo.speed
    start = times[-1] - times[0] + end
    for _ in range(8):  # where it ends depends on where it starts as it would without inertia, nearly
        left = _latent_motion(start, steps, dt, tempo.settle, damping_rate)
        start += tempo.settle * (np.log(np.sinh(end / tempo.settle)) - _log_sinh(max(left[-1], 1e-9) / tempo.settle))
    left = left - left[-1] * np.linspace(0, 1, steps + 1)
    return tempo.speed * np.interp(times, times[0] + dt * np.arange(steps + 1), left)


def _latent_motion(start: float, steps: int, dt: float, settle: float, damping_rate: float) -> np.ndarray:
    """The radius over the speed [steps + 1], s, from rest at `start`."""
    left, rate = np.empty(steps + 1), 0.0
    left[0], decay = start, np.exp(-damping_rate * dt)
    for i in range(steps):
        wanted = -np.tanh(left[i] / settle)
        left[i + 1] = left[i] + wanted * dt + (rate - wanted) * (1 - decay) / damping_rate
        rate = wanted + (rate - wanted) * decay
    return left


def _log_sinh(x: float) -> float:
    return x + np.log1p(-np.exp(-2 * x)) - np.log(2)


def _length(path: np.ndarray) -> np.ndarray:
    """How long a path [S, m] is up to each of its points [S]."""
    return np.append(0.0, np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum())
