"""Live plots: the energy and what the certificate allows, the leaves' shares, the smallest distances."""

from collections import deque
from typing import Any

import numpy as np

from .._palette import GREY, SERIES

_POINTS = 300
_COLOURS = (*SERIES[:-1], GREY)
_DASHES = ((), (6, 3), (2, 2))  # of one round of colours after the other, pixels
_HEIGHT = 200
_LEAST = 0.01  # of an axis' end: below, ticks would be all zeros


def round_end(value: float) -> float:
    """The least of 1, 2, 5, 10, ... times a power of ten that is not below `value`, and `_LEAST` at least."""
    if not value > _LEAST:
        return _LEAST
    power = 10.0 ** np.floor(np.log10(value) + 1e-9)
    return float(next(k * power for k in (1, 2, 5, 10) if k * power >= value * (1 - 1e-9)))


def stroke(k: int) -> dict[str, Any]:
    """How the `k`-th series is drawn: the figures' colours, then the same dashed."""
    dash = _DASHES[k // len(_COLOURS) % len(_DASHES)]
    return {"stroke": _COLOURS[k % len(_COLOURS)], **({"dash": dash} if dash else {})}


class Chart:
    """One plot of some named series over the last half minute of samples."""

    def __init__(self, server: Any, title: str, names: tuple[str, ...], limits: tuple[float, float] | None = None):
        self._rows: deque[tuple[float, ...]] = deque(maxlen=_POINTS)
        series = [{"label": "s"}]
        for k, name in enumerate(names):
            series.append({"label": name, "width": 1.5, **stroke(k)})  # pyright: ignore
        self._fixed, self._limits = limits is not None, limits or (0.0, 1.0)
        self._plot = server.gui.add_uplot(
            tuple(np.zeros(2) for _ in series),
            tuple(series),
            title=title,
            scales=self._scales(),
            axes=({"size": 40, "space": 60}, {"size": 58, "space": 30}),
            legend={"show": True},
            height=_HEIGHT,
        )

    def _scales(self) -> dict[str, Any]:
        return {"x": {"time": False}, "y": {"range": self._limits}}

    def add(self, time: float, values: tuple[float, ...]) -> None:
        """Add a sample of all series; a time before the last begins anew."""
        if self._rows and time < self._rows[-1][0]:
            self._rows.clear()
        if self._rows and time == self._rows[-1][0]:
            self._rows.pop()
        self._rows.append((time, *values))
        if len(self._rows) > 1:
            shown = np.array([row[1:] for row in self._rows], float)
            shown = shown[np.isfinite(shown)]
            if not self._fixed and shown.size:
                low, high = float(shown.min()), float(shown.max())
                # A little beyond, so that the last tick is there in full.
                limits = (-1.05 * round_end(-low) if low < -0.01 * high else 0.0, 1.05 * round_end(high))
                if limits != self._limits:
                    self._limits = limits
                    self._plot.scales = self._scales()
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
            self._shares = Chart(server, "share of each leaf in the force", leaves, (0.0, 1.05))
            self._distances = Chart(server, "smallest distance (cm)", distances) if distances else None
        panel.dock_left()
        panel.set_width(340)

    def add(self, time: float, energy: tuple[float, float], shares: np.ndarray, distances: list[float]) -> None:
        """One more sample; distances in m."""
        self._energy.add(time, energy)
        self._shares.add(time, tuple(float(s) for s in shares))
        if self._distances is not None:
            self._distances.add(time, tuple(100 * d for d in distances))
