"""Which trials a run makes: from the demonstrated starts, then from seeded variations of them."""

from collections.abc import Sequence

import numpy as np

from .._errors import ConfigurationError
from ..scenes import Scene
from ._trials import Displacement, Trial

DISPLACEMENT = 0.10
"""How far the object is displaced during execution, m."""
_ATTEMPTS = 1000


def sample_trials(
    scene: Scene,
    paths: Sequence[np.ndarray],
    poses: Sequence[np.ndarray],
    count: int,
    *,
    seed: int = 0,
    displace: bool = False,
) -> list[Trial]:
    """The demonstrated starts, each with the object where it was then, and after them variations of them in turn.

    Variations are those of the `scene` (`Scene.vary`). With `displace` there are none, but the object is moved by
    `DISPLACEMENT` in a random horizontal direction, 0.5 to 2.5 s after the start, in every trial. Variations in
    collision at the start are drawn again.

    **Arguments**: `paths`, N demonstrations [T, n], rad; `poses`, the object's N poses [4, 4] in them; the same `seed`
    gives the same trials, whatever `count` is.
    **Raises** `ConfigurationError` for a count below one, a demonstrated start in collision, or if no variation free of
    collision is found.
    """
    if count < 1:
        raise ConfigurationError(f"trials is {count}: give at least one.")
    trials = []
    for k in range(count):
        i, rng = k % len(paths), np.random.default_rng([seed, k])
        trial = Trial(np.asarray(paths[i][0], float), np.asarray(poses[i], float))
        if k >= len(paths) and not displace:
            key = [seed, k // len(paths) if scene.per_round else k, 7]
            trial = _variation(scene, trial, list(zip(paths, poses, strict=True)), key)
        if displace:
            angle, start = rng.uniform(-np.pi, np.pi), rng.uniform(0.5, 2.5)
            offset = DISPLACEMENT * np.array([np.cos(angle), np.sin(angle), 0.0])
            trial = trial._replace(displacement=Displacement(offset, start=start))
        trials.append(trial)
    return trials


def _variation(scene: Scene, trial: Trial, shown, key: list[int]) -> Trial:
    rng = np.random.default_rng(key)
    for _ in range(_ATTEMPTS):
        found = scene.vary(trial, rng, shown)
        if found is not None and not scene.at(found).touches(found.q[None]):
            return found
    raise ConfigurationError(f"no variation of scene {scene.name!r} free of collision in {_ATTEMPTS} attempts.")
