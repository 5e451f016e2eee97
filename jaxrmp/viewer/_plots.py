"""Live plots: the energy and what the certificate allows, the leaves' shares, the smallest distances."""

from collections import deque
from typing import Any

import numpy as np

_POINTS = 300
_COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#8c564b",
    "#7f7f7f",
    "#bcbd22",
    "#17becf",
)
_HEIGHT = 190


class Chart:
    """One plot of some named series over the last half minute of samples."""

    def __init__(self, server: Any, title: str, names: tuple[str, ...], limits: tuple[float, float] | None = None):
        self._rows: deque[tuple[float, ...]] = deque(maxlen=_POINTS)
        series = [{"label": "s"}]
        for k, name in enumerate(names):
            series.append({"label": name, "stroke": _COLOURS[k % len(_COLOURS)], "width": 1.5})  # pyright: ignore
        scales: dict[str, Any] = {"x": {"time": False}}
        if limits:
            scales["y"] = {"range": limits}
        self._plot = server.gui.add_uplot(
            tuple(np.zeros(2) for _ in series),
            tuple(series),
            title=title,
            scales=scales,
            axes=({"size": 28}, {"size": 52}),
            legend={"show": True},
            height=_HEIGHT,
        )

    def add(self, time: float, values: tuple[float, ...]) -> None:
        """Add a sample of all series; a time before the last begins anew."""
        if self._rows and time < self._rows[-1][0]:
            self._rows.clear()
        if self._rows and time == self._rows[-1][0]:
            self._rows.pop()
        self._rows.append((time, *values))
        if len(self._rows) > 1:
            self._plot.data = tuple(np.array(column, float) for column in zip(*self._rows, strict=True))


class Plots:
    """The three charts, in a panel of their own at the left edge.

    **Arguments**: `server`; `leaves`, the names of the shares; `distances`, those of the smallest distances.
    """

    def __init__(self, server: Any, leaves: tuple[str, ...], distances: tuple[str, ...]):
        panel = server.gui.add_panel()
        with panel.add_tab("What the policy does"):
            self._energy = Chart(server, "energy V, and what its certificate allows", ("V", "allowed"))
            self.certificate = server.gui.add_markdown("")
            self._shares = Chart(server, "share of each leaf in the force", leaves, (0.0, 1.0))
            self._distances = Chart(server, "smallest distance (cm)", distances) if distances else None
        panel.dock_left()
        panel.set_width(340)

    def add(self, time: float, energy: tuple[float, float], shares: np.ndarray, distances: list[float]) -> None:
        """One more sample; distances in m."""
        self._energy.add(time, energy)
        self._shares.add(time, tuple(float(s) for s in shares))
        if self._distances is not None:
            self._distances.add(time, tuple(100 * d for d in distances))
