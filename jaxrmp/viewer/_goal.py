"""How far it is to the goal, in words, and the goal as numbers."""

from typing import Any

import numpy as np

_THERE, _STILL, _LONG = 0.01, 0.02, 1.0  # m; rad/s or m/s, below which nothing moves; s of simulated time
_NEAR = 0.03  # m, within which something may hold the arm off


def goal_words(distance: float, resting: bool, near: dict[str, float], off: bool = False) -> str:
    """What to say of a goal at a `distance`, m, NaN where there is none: whether the arm is there, on the way, or
    `resting` away from it; then why: leaves are switched `off`, or something is near, of smallest distances `near`, m,
    by what they are to, or it is out of reach."""
    if not np.isfinite(distance):
        return "distance to the goal: not checked"
    away = f"{1000 * distance:.1f} mm" if distance < 0.1 else f"{100 * distance:.0f} cm"
    if distance < _THERE:
        return f"at the goal: {away} off"
    if not resting:
        return f"{away} to the goal"
    if off:
        return f"**at rest {away} from the goal**: leaves are switched off"
    close = [f"{1000 * d:.0f} mm {what}" for what, d in near.items() if d < _NEAR]
    if close:
        return f"**at rest {away} from the goal, held off**: {', '.join(close)}"
    return f"**at rest {away} from the goal: out of reach from here**"


class Resting:
    """Whether the arm has been at rest for a second of simulated time."""

    def __init__(self):
        self._since = np.inf

    def see(self, time: float, qd: np.ndarray, changed: bool) -> bool:
        """Take in speeds `qd` [n] at `time`, s; `changed`, whether something from outside has changed."""
        if changed or np.abs(qd).max() > _STILL or time < self._since:
            self._since = np.inf if changed or np.abs(qd).max() > _STILL else time
        return time - self._since >= _LONG


class GoalNumbers:
    """The goal's place as three numbers beside its gizmo: either follows the other."""

    def __init__(self, server: Any, target: Any, name: str):
        self._target = target
        self._box = server.gui.add_vector3(f"{name} (m)", self._rounded(), step=0.01)

        @self._box.on_update
        async def _(event: Any) -> None:
            if event.client_id is not None:  # a person's doing, not that of the line below
                target.position = np.array(self._box.value, float)

        @target.on_update
        async def _(_: Any) -> None:
            self._box.value = self._rounded()

    def _rounded(self) -> tuple[float, float, float]:
        x, y, z = (round(float(v), 3) for v in self._target.position)
        return x, y, z
