"""Three-dimensional panels: equal scales, a telling view, and each box as large as its place on the page allows."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ._style import NOTE, TICK, TITLE, Axes3D, Figure

_PAD = 0.04  # of the largest extent, around the points
_THINNEST = 0.25  # of the largest extent: a flatter box has no room for its own tick labels
_TITLE, _LEGEND = 0.35, 0.45  # inches above each panel and below all of them


def space_panels(figure: Figure, points: np.ndarray, titles: Sequence[str], columns: int) -> list[Axes3D]:
    """One panel a title, in rows of `columns`, all with the same view of a box around `points` [S, 3], m."""
    figure.set_layout_engine("none")  # the layout engines know nothing of what sticks out of a 3-D box
    rows = -(-len(titles) // columns)
    foot = _LEGEND / figure.get_figheight()
    width, height = 1 / columns, (1 - foot) / rows
    title = _TITLE / figure.get_figheight()
    panels: list[Axes3D] = []
    shift, zoom = np.zeros(2), 1.0
    for n, text in enumerate(titles):
        left, bottom = n % columns * width, foot + (rows - 1 - n // columns) * height
        axes: Axes3D = figure.add_subplot(projection="3d")  # type: ignore[assignment]
        axes.set_position((left, bottom, width, height - title))
        size = _set_box(axes, points)
        if n == 0:
            shift, zoom = _fit(figure, axes, size)
        axes.set_box_aspect(size, zoom=zoom)
        axes.set_position((left + shift[0], bottom + shift[1], width, height - title))
        up = 1 + (0.6 * title - shift[1]) / (height - title)
        axes.set_title(text, fontsize=TITLE, x=0.5 - shift[0] / width, y=up, pad=0)
        panels.append(axes)
    return panels


def view_angles(points: np.ndarray) -> tuple[float, float]:
    """Elevation and azimuth, degrees, of a look at `points` [S, 3] near the direction in which they spread least."""
    normal = np.linalg.svd(points - points.mean(0), full_matrices=False)[2][2]
    normal = normal if normal[2] >= 0 else -normal
    azimuth = np.degrees(np.arctan2(normal[1], normal[0])) + 20.0  # askew, so that depth shows
    return float(np.clip(np.degrees(np.arcsin(normal[2])), 20.0, 45.0)), float(azimuth)


def _set_box(axes: Axes3D, points: np.ndarray) -> np.ndarray:
    """Limits, view and labels; returns the box's edge lengths, m."""
    low, high = points.min(0), points.max(0)
    size = np.maximum(high - low, _THINNEST * (high - low).max()) + 2 * _PAD * (high - low).max()
    low, high = (low + high - size) / 2, (low + high + size) / 2
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_proj_type("ortho")
    elevation, azimuth = view_angles(points)
    axes.view_init(elev=elevation, azim=azimuth)
    three: tuple[Any, ...] = (axes.xaxis, axes.yaxis, axes.zaxis)
    for name, axis, length in zip("xyz", three, size, strict=True):
        axis.get_major_locator().set_params(nbins=max(round(5 * length / size.max()), 2))
        axis.set_pane_color((1, 1, 1, 0))
        axis.set_label_text(f"{name} (m)", fontsize=TICK)
    axes.tick_params(labelsize=NOTE, pad=0)
    return size


def _fit(figure: Figure, axes: Axes3D, size: np.ndarray) -> tuple[np.ndarray, float]:
    """The shift (of the figure's size) and zoom with which a box and its labels just fill the axes' place."""
    from matplotlib.transforms import Bbox
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    zoom, place = 1.0, axes.get_position(original=True).transformed(figure.transFigure)
    box = place
    corners = np.stack(np.meshgrid(axes.get_xlim(), axes.get_ylim(), axes.get_zlim())).reshape(3, -1)
    for _ in range(4):  # labels do not grow with the box, so one step is not enough
        axes.set_box_aspect(size, zoom=zoom)
        figure.draw_without_rendering()
        # Where the box with its ticks and labels lies on the page, pixels.
        x, y, _ = proj_transform(corners[0], corners[1], corners[2], axes.get_proj())
        projected = axes.transData.transform(np.stack([x, y], axis=1))
        labels = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
        box = Bbox.union([Bbox([projected.min(0), projected.max(0)]), *(box for box in labels if box is not None)])
        zoom *= 0.94 * min(place.width / box.width, place.height / box.height)
    shift = (np.array(place.p0) + place.p1 - box.p0 - box.p1) / 2
    return shift / figure.bbox.size, zoom
