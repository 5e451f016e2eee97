"""Demonstrated and reproduced control points in space."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._errors import ShapeError
from .._palette import BLACK, BLUE, GOAL, VERMILLION, WHITE
from ..learning import PreparedDemonstrations, Reproduction, resample_by_arc_length
from ._space import space_panels
from ._style import LINE, MARKER, STAR, THICK, Axes3D, Figure, legend_below, new_figure

_INSTANTS = 8


def triangle_figure(prepared: PreparedDemonstrations, reproduction: Reproduction) -> Figure:
    """Where the control points went in each demonstration and where they go in its reproduction, one panel each.

    At instants even in arc length the points are joined up, three to a triangle; the lines are the paths of their
    centres. In the object's frame; of a turn alone, about the centres.

    **Arguments**: `prepared`, the demonstrations; `reproduction`, of the same ones, by `reproduce`.
    **Returns** a matplotlib `Figure`.
    **Raises** `ShapeError` if the two do not belong together; `MissingDependencyError` without matplotlib.

    Rana et al. 2019, figures 4 and 6.
    """
    N, K = len(prepared.points), prepared.points[0].shape[1]
    if reproduction.points.shape[0] != N or reproduction.points.shape[2] != K:
        raise ShapeError(
            f"reproduction holds points of shape {reproduction.points.shape}, expected [{N}, T, {K}, 3] for {N} "
            f"demonstrations of {K} control points. Reproduce these demonstrations."
        )
    columns = min(N, 3)
    figure = new_figure(2.6 * -(-N // columns) + 0.45)
    space = np.concatenate([p.reshape(-1, 3) for p in (*prepared.points, *reproduction.points)])
    titles = [f"demonstration {n}: {_how_far(errors)}" for n, errors in enumerate(reproduction.errors)]
    panels = space_panels(figure, space, titles, columns)
    for axes, demonstrated, reproduced in zip(panels, prepared.points, reproduction.points, strict=True):
        _draw(axes, demonstrated, BLUE, THICK, "demonstrated")
        _draw(axes, reproduced, VERMILLION, LINE, "reproduced")
        start, goal = demonstrated[[0, -1]].mean(1)
        ends = {"linestyle": "", "markeredgecolor": BLACK, "zorder": 10, "clip_on": False}
        axes.plot(*start[:, None], marker="o", color=WHITE, markersize=MARKER, label="start", **ends)
        axes.plot(*goal[:, None], marker="*", color=GOAL, markersize=STAR, label="goal", **ends)
    legend_below(figure, panels[0])
    return figure


def _how_far(errors: Mapping[str, Any]) -> str:
    if errors["dtw_cm"] is None:
        return f"turn {errors['turn_deg']:.2f} degrees"
    return f"dtw {errors['dtw_cm']:.2f} cm"


def outlines(points: np.ndarray, instants: int = _INSTANTS) -> np.ndarray:
    """Control points [T, K, 3] joined up at instants even in arc length, as one line [S, 3] with gaps of NaN.

    Three points or more give closed outlines, two a stroke, one a point.
    """
    shapes = resample_by_arc_length(points, instants)
    closing = shapes[:, :1] if shapes.shape[1] > 2 else shapes[:, :0]
    gap = np.full((instants, 1, 3), np.nan)
    return np.concatenate([shapes, closing, gap], axis=1).reshape(-1, 3)


def _draw(axes: Axes3D, points: np.ndarray, color: str, width: float, label: str) -> None:
    # Unclipped: the box may reach beyond the square that matplotlib gives to 3-D axes.
    axes.plot(*points.mean(1).T, color=color, linewidth=0.7 * width, clip_on=False)
    marker = "o" if points.shape[1] == 1 else None
    axes.plot(
        *outlines(points).T, color=color, linewidth=width, marker=marker, markersize=MARKER, label=label, clip_on=False
    )
