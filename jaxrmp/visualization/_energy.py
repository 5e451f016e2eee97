"""The Lyapunov function along rollouts: does it ever rise?"""

import numpy as np

from ..learning import Reproduction
from ._style import Figure, label_axes, legend_below, new_figure, series_style

_ROUNDING = 1e-6  # a smaller share of the range is rounding in single precision


def energy_figure(reproduction: Reproduction) -> Figure:
    """The whole policy's Lyapunov function V and the joint speed along every rollout of `reproduction`.

    V is shown above its lowest value, as a share of its range; its largest rise in one step stands in the title.

    **Returns** a matplotlib `Figure`. **Raises** `MissingDependencyError` without matplotlib.

    Rana et al. 2019, theorem 1 on stability.
    """
    figure = new_figure()
    left, right = figure.subplots(1, 2)
    rollouts = reproduction.rollouts
    time, qd = np.asarray(rollouts.time, float), np.asarray(rollouts.qd, float)
    heights = relative_energy(rollouts.energy)
    for n, style in enumerate(series_style(len(heights))):
        left.semilogy(time[n], np.maximum(heights[n], _ROUNDING), label=f"demonstration {n}", **style)
        right.plot(time[n], np.linalg.norm(qd[n], axis=-1), **style)
    rise = max(errors["energy_increase"] for errors in reproduction.errors)
    title = f"largest rise in one step:\n{rise:.1e} of the range of V"
    label_axes(left, "time (s)", r"$(V - \min V)\,/\,(\max V - \min V)$", title)
    label_axes(right, "time (s)", r"joint speed $|\dot q|$ (rad/s or m/s)")
    left.set_ylim(_ROUNDING, 2)
    right.set_ylim(bottom=0)
    for axes in (left, right):
        axes.set_xlim(0, time.max())
    legend_below(figure, left)
    return figure


def relative_energy(energy: np.ndarray) -> np.ndarray:
    """Energies [N, T] above each row's lowest, as shares of the row's range; zeros for a row that does not change."""
    energy = np.asarray(energy, float)
    span = np.ptp(energy, axis=-1, keepdims=True)
    return (energy - energy.min(-1, keepdims=True)) / np.where(span > 0, span, 1.0)
