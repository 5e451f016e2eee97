"""What tells a policy where the object of its scene is, trial by trial: a model of a tracker's noise, or a camera."""

from typing import Any, Protocol

import numpy as np


class Sight(Protocol):
    """What a tracker carries through a trial: `seen` [4, 4], the object's pose as the policy is told, and `stamp`, s,
    when it was there."""

    @property
    def seen(self) -> np.ndarray:
        """The pose, `T_world_object`."""
        ...

    @property
    def stamp(self) -> float:
        """Seconds since the start of the trial; minus infinity if the pose is a guess."""
        ...


class Tracker(Protocol):
    """A tracker without state: what it carries is a `Sight`, one a trial. `TrackerSettings` is one.

    `keep`, s, how long a policy goes on with a pose that is no longer confirmed before the arm brakes.
    """

    @property
    def keep(self) -> float:
        """Seconds."""
        ...

    def start(self, scene: Any, data: Any, seed: tuple[int, ...]) -> Any:
        """The `Sight` before a trial begins: the arm of the `scene` is at rest in `data`, forward computed; `seed`,
        integers, of all chance."""
        ...

    def observe(self, sight: Any, time: float, scene: Any, data: Any) -> Any:
        """The `Sight` at `time`, s since the start: `sight`, what it was, is not changed.

        To be called every step; `data`, a state of the `scene` whose positions are up to date.
        """
        ...

    def age(self, sight: Any, time: float) -> float:
        """Seconds at `time` for which the pose of `sight` has gone unconfirmed, the tracker's own delay aside."""
        ...

    def report(self, sight: Any) -> Any:
        """How it went up to `sight`, a named tuple of numbers; None for a tracker that has nothing to say."""
        ...
