"""The object's pose as a camera delivers it: 30 times a second, noisy, late, sometimes not at all.

A state machine without hidden state: the same settings, seed and true poses give the same observations.
"""

from typing import Any, NamedTuple

import numpy as np

from .._errors import ConfigurationError
from .._ranges import BelowOne, NonNegative, Positive, settings
from .._rotations import rotation_of_vector


@settings("tracker")
class TrackerSettings:
    """What the tracker is like.

    `rate`, frames a second. Noise, of each coordinate, in m, and about each axis, in rad: `jitter`, of every frame on
    its own, and `drift`, slow, of correlation time `drift_time` s; `bias`, of each coordinate, m, one constant error a
    trial. `delay`, s, from a frame to its arrival; `dropouts`, the share of frames that never arrive; `silent_after`,
    s, from when on no frame arrives at all. `keep`, s, how long the policy goes on with a pose that is no longer
    confirmed before it brakes.

    The defaults are what the paper's RGB-D tracker does while neither the door nor the arm moves: the still stretches
    of the three door demonstrations with a live tracker (`python -m benchmarks tracker`). The 1.5 to 2.8 cm by which
    its pose of the resting door differs after the arm's motion from before it do not average out; `bias` stands for
    them.

    **Raises** `ConfigurationError` for a value that makes no sense.
    """

    rate: Positive[float] = 30.0
    jitter: NonNegative[tuple[float, float]] = (0.0006, 0.0009)
    drift: NonNegative[tuple[float, float]] = (0.0017, 0.0068)
    drift_time: Positive[float] = 2.0
    bias: NonNegative[float] = 0.0
    delay: NonNegative[float] = 0.0
    dropouts: BelowOne[NonNegative[float]] = 0.0
    silent_after: float = np.inf
    keep: Positive[float] = 0.5

    def __post_init__(self):
        for name in ("jitter", "drift"):
            if len(getattr(self, name)) != 2:
                raise ConfigurationError(f"tracker.{name} is {getattr(self, name)!r}, expected (metres, radians).")
        if not self.silent_after >= 0:
            raise ConfigurationError(f"tracker.silent_after is {self.silent_after!r}, expected seconds.")

    def start(self, scene: Any, data: Any, seed: tuple[int, ...]) -> "TrackerState":
        """As `Tracker.start`: the object of the `scene` has just been seen where it is in `data`; `seed`, of the
        noise."""
        return start_tracker(self, seed, scene.object_pose(data))

    def observe(self, sight: "TrackerState", time: float, scene: Any, data: Any) -> "TrackerState":
        """As `Tracker.observe`: `sight` after a look at `time`, s, at the object of the `scene` in `data`."""
        return observe(self, sight, time, scene.object_pose(data))

    def age(self, sight: "TrackerState", time: float) -> float:
        """Seconds at `time`, s, since the frame of `sight` arrived."""
        return max(time - sight.stamp - self.delay, 0.0)

    def report(self, sight: "TrackerState") -> None:
        """Nothing: the errors of `sight` are those of the settings."""


PERFECT = TrackerSettings(jitter=(0.0, 0.0), drift=(0.0, 0.0))
"""A tracker without noise, 30 times a second."""


class TrackerState(NamedTuple):
    """What a tracker carries from one observation to the next.

    `seen` [4, 4], the last pose that arrived, and its `stamp`, s; `frame`, the next one's number; `drift` [6], m and
    rad; `on_the_way`, frames as (stamp, pose) in order; `seed`.
    """

    seen: np.ndarray
    stamp: float
    frame: int
    drift: np.ndarray
    on_the_way: tuple[tuple[float, np.ndarray], ...]
    seed: tuple[int, ...]


def start_tracker(settings: TrackerSettings, seed: tuple[int, ...], T: np.ndarray) -> TrackerState:
    """A tracker that has been running before the start: the object at pose `T` [4, 4] has just been seen.

    **Arguments**: `settings`; `seed`, integers, of all its noise.
    """
    rng = np.random.default_rng([*seed, 0])
    drift = rng.normal(size=6) * np.repeat(settings.drift, 3)
    drift[:3] += rng.normal(size=3) * settings.bias
    return TrackerState(_noisy(settings, T, drift, rng), 0.0, 1, drift, (), tuple(seed))


def observe(settings: TrackerSettings, state: TrackerState, time: float, T: np.ndarray) -> TrackerState:
    """Let the tracker look at the object at pose `T` [4, 4] at `time`, s; to be called at least once a frame.

    At the time of a frame it takes one, unless that drops out or the tracker is silent; frames older than the delay
    arrive. `settings`, as at its start; `state`, what it was; **returns** what it is now.
    """
    seen, stamp, frame, drift, on_the_way, seed = state
    if time >= frame / settings.rate - 1e-9:
        rng = np.random.default_rng([*seed, frame])
        lost = rng.uniform() < settings.dropouts or time >= settings.silent_after
        keep = np.exp(-1.0 / (settings.rate * settings.drift_time))
        constant, spread = _constant(settings, seed), np.repeat(settings.drift, 3)
        drift = constant + keep * (drift - constant) + np.sqrt(1 - keep**2) * rng.normal(size=6) * spread
        if not lost:
            on_the_way = (*on_the_way, (time, _noisy(settings, T, drift, rng)))
        frame += 1
    while on_the_way and on_the_way[0][0] + settings.delay <= time + 1e-9:
        (stamp, seen), *later = on_the_way
        on_the_way = tuple(later)
    return TrackerState(seen, stamp, frame, drift, on_the_way, seed)


def _constant(settings: TrackerSettings, seed: tuple[int, ...]) -> np.ndarray:
    """The constant error of a trial, as drawn by `start_tracker`."""
    rng = np.random.default_rng([*seed, 0])
    rng.normal(size=6)
    return np.concatenate([rng.normal(size=3) * settings.bias, np.zeros(3)])


def _noisy(settings: TrackerSettings, T: np.ndarray, drift: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    error = drift + rng.normal(size=6) * np.repeat(settings.jitter, 3)
    seen = np.array(T, float)
    seen[:3, :3] = seen[:3, :3] @ rotation_of_vector(error[3:])
    seen[:3, 3] += error[:3]
    return seen
