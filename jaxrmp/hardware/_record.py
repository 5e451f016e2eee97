"""Motions of an arm that somebody guides by hand, as demonstrations."""

from collections.abc import Callable

import numpy as np

from .._errors import ArmError, ConfigurationError
from ._arm import Arm
from ._sightings import Sightings


def record(
    arm: Arm, running: Callable[[], bool], rate: float = 100.0, sightings: Sightings | None = None, keep: float = 0.5
) -> dict[str, np.ndarray]:
    """Read an `arm` that is not driven while `running` says so, and keep `rate` of its states a second.

    **Arguments**: `rate`, Hz, at most that of the arm's cycles; `sightings`, where the object is, None for no
    object, at most `keep`, s, old.
    **Returns** `time` [T] from zero, s, by the arm's clock, `joint_positions` [T, n], and with `sightings`
    `T_world_object` [T, 4, 4]: what `save_motion` takes.
    **Raises** `ConfigurationError` for a rate that the arm does not have; `ArmError` if it cannot be read any more.
    """
    if not 0 < rate <= 1.0 / arm.period + 1e-6:
        raise ConfigurationError(f"rate is {rate:g} Hz, expected at most the arm's {1.0 / arm.period:g}.")
    time, q, T = list[float](), list[np.ndarray](), list[np.ndarray]()
    due = -np.inf
    while running():
        try:
            state = arm.read()
        except ArmError:
            if len(time) < 2:
                raise
            break  # what was recorded is kept; who reads on is told
        if state.time < due:
            continue
        due = max(due + 1.0 / rate, state.time + 0.5 / rate)
        time.append(state.time)
        q.append(state.q.astype(float))
        if sightings is not None:
            seen = sightings.newest()
            if seen.age > keep:
                raise ConfigurationError(
                    f"the tracker is silent: its last pose is {seen.age:.2f} s old. Record again once it tracks."
                )
            T.append(np.array(seen.T_world_object, float))
    found = {
        "time": np.array(time) - (time[0] if time else 0.0),
        "joint_positions": np.array(q).reshape(-1, arm.joints),
    }
    return found | ({"T_world_object": np.array(T)} if sightings is not None else {})
