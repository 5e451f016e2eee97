"""Which leaf is doing that, and when?"""

from typing import Any

import numpy as np

from .._errors import ShapeError
from .._palette import BLACK, PALE
from ..inspection import Inspection
from ._style import TALL, THICK, THIN, TICK, Figure, label_axes, legend_below, new_figure, series_style


def inspection_figure(inspection: Inspection, time: Any, rows: int = 6) -> Figure:
    """Every leaf's part in a rollout over time.

    Above, the leaves' shares of the force and of the metric at the root, stacked; below, each leaf's gap (the
    distance left to its goal, or the one that it keeps, if it is about either) and energy, with the whole tree's in
    black. Leaves with the greatest share of the force at any time are shown by name, the rest as one; those marked
    `*` void the certificate.

    **Arguments**: `inspection`, with a leading axis of T states; `time` [T], s; `rows`, how many leaves to name.
    **Returns** a matplotlib `Figure`.
    **Raises** `ShapeError` if the inspection is not of T states; `MissingDependencyError` without matplotlib.
    """
    time = np.asarray(time, float)
    force, metric, gap, energy = (
        np.asarray(a, float)
        for a in (inspection.force_share, inspection.metric_share, inspection.gap, inspection.energy)
    )
    if force.ndim != 2 or time.shape != force.shape[:1]:
        raise ShapeError(
            f"time has shape {time.shape} and the inspection leading axes {force.shape[:-1]}, expected one axis of "
            "time for both: jax.vmap(inspect, (None, 0, 0))(tree, path.q, path.qd)."
        )
    order = np.argsort(-force.max(0), kind="stable")
    named = order[: rows + 1] if len(order) == rows + 1 else order[:rows]
    rest = order[len(named) :]
    labels = [inspection.names[i] + ("" if inspection.certified[i] else " *") for i in named]
    styles = series_style(len(named))
    colors = [style["color"] for style in styles]
    if rest.size:
        labels.append(f"{rest.size} more")
        colors.append(PALE)

    figure = new_figure(TALL)
    (forces, metrics), (gaps, energies) = figure.subplots(2, 2, sharex=True)
    for axes, share in ((forces, force), (metrics, metric)):
        stacked = list(100 * share[:, named].T)
        if rest.size:
            stacked.append(100 * share[:, rest].sum(1))
        axes.stackplot(time, stacked, colors=colors, labels=labels, alpha=0.85, linewidth=0)
        axes.set_ylim(0, 100)
    for i, style in zip(named, styles, strict=True):
        gaps.plot(time, gap[:, i], **style)
        energies.plot(time, energy[:, i], **style)
    energies.plot(time, energy.sum(1), color=BLACK, linewidth=THICK, label="whole tree")
    energies.legend(frameon=False, fontsize=TICK)
    gaps.axhline(0, color=BLACK, linewidth=THIN)
    label_axes(forces, "", "share of the force (%)", "force at the root")
    label_axes(metrics, "", "share of the metric (%)", "metric at the root")
    label_axes(gaps, "time (s)", "gap (units of the leaf's space)", "distance left to the goal, or kept")
    label_axes(energies, "time (s)", "energy $V$", "energy")
    forces.set_xlim(time.min(), time.max() if np.ptp(time) > 0 else time.min() + 1)
    legend_below(figure, forces)
    return figure
