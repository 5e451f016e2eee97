"""Plots of rows, in the style of the library's own figures."""

from collections.abc import Sequence
from typing import Any

from jaxrmp.visualization._style import MARKER, MARKERS, NOTE, TALL, label_axes, legend_below, new_figure, series_style


def bars(rows: Sequence[dict[str, Any]], columns: Sequence[str], unit: str) -> Any:
    """One group of horizontal bars a row, on a logarithmic axis, with their values."""
    shown = [row for row in rows if any(row.get(column) for column in columns)]
    figure = new_figure(1.4 + 0.28 * len(columns) * len(shown))
    axes = figure.subplots()
    height = 0.8 / len(columns)
    for k, (column, style) in enumerate(zip(columns, series_style(len(columns)), strict=True)):
        at = [i + (k - (len(columns) - 1) / 2) * height for i in range(len(shown))]
        drawn = axes.barh(at, [row.get(column) or float("nan") for row in shown], height, color=style["color"])
        drawn.set_label(column)
        axes.bar_label(drawn, fmt="%.3g", padding=2, fontsize=NOTE)
    label_axes(axes, unit, "")
    axes.set_xscale("log")
    axes.margins(x=0.15)
    axes.set_yticks(range(len(shown)), [str(row["name"]) for row in shown])
    axes.invert_yaxis()
    if len(columns) > 1:
        legend_below(figure, axes)
    return figure


def curves(series: dict[str, tuple[Sequence[float], Sequence[float]]], x: str, y: str, title: str = "") -> Any:
    """Several curves `name: (x, y)` on logarithmic axes."""
    figure = new_figure(TALL)
    axes = figure.subplots()
    for (name, (at, values)), style, k in zip(
        series.items(), series_style(len(series)), range(len(series)), strict=True
    ):
        axes.loglog(at, values, marker=MARKERS[k % len(MARKERS)], markersize=MARKER, label=name, **style)
    label_axes(axes, x, y, title)
    legend_below(figure, axes)
    return figure
