"""Pulling at the arm's hand with a gizmo, or pushing it with a button."""

import threading
from typing import Any

import numpy as np

_RATE = 12.0  # 1/s, of the spring on the hand's own weight
_SECONDS, _REACH = 0.5, 0.15  # of a push by the button: how long, how far away the spring's other end is, m


class PushGizmo:
    """A gizmo at the hand that pulls it while it is dragged, and a button that pushes it for half a second.

    How strong: the spring pulls as if the hand weighed what the policy's metric says it weighs, times the slider.
    """

    def __init__(self, server: Any, hand: np.ndarray):
        self._gizmo = server.scene.add_transform_controls(
            "/push", scale=0.13, disable_rotations=True, line_width=1.5, position=hand, opacity=0.6, visible=False
        )
        self._shown = server.gui.add_checkbox("gizmo at the hand to pull it", False)
        self._strength = server.gui.add_slider("strength", 0.2, 5.0, step=0.1, initial_value=1.0)
        self._direction = server.gui.add_dropdown("direction", ("+x", "-x", "+y", "-y", "+z", "-z"))
        button = server.gui.add_button("Push", icon="hand-finger")
        self._dragged, self._goal, self._until = False, np.asarray(hand, float), 0.0
        self._lock = threading.Lock()
        self._now, self._hand, self.weight = 0.0, np.asarray(hand, float), 1.0

        @self._gizmo.on_update
        async def _(event: Any) -> None:
            self._dragged = event.phase != "end"

        @button.on_click
        async def _(_: Any) -> None:
            self.push(self._direction.value)

    def push(self, direction: str) -> None:
        """Push the hand for half a second along an axis of the world, such as "-x"."""
        step = np.zeros(3)
        step["xyz".index(direction[1])] = _REACH if direction[0] == "+" else -_REACH
        with self._lock:
            self._goal, self._until = self._hand + step, self._now + _SECONDS

    def follow(self, time: float, hand: np.ndarray) -> None:
        """Tell it the simulated time and where the hand is [3]: the gizmo sits there unless it is dragged."""
        with self._lock:
            self._now, self._hand = time, hand
        self._gizmo.visible = bool(self._shown.value)
        if self._gizmo.visible and not self._dragged:
            self._gizmo.position = hand

    def read(self) -> tuple[np.ndarray, float, float]:
        """Where the spring's other end is [3], its stiffness and its damping rate; both zero if nobody pulls."""
        with self._lock:
            pushed, goal = self._now < self._until, self._goal
        if self._dragged:
            pushed, goal = True, np.asarray(self._gizmo.position, float)
        if not pushed:
            return np.zeros(3), 0.0, 0.0
        k = self._strength.value * self.weight
        return goal, k * _RATE * _RATE, k * _RATE
