"""The learned field of one subtask: the potential alone, and warped by the metric."""

import jax
import numpy as np

from .._errors import ConfigurationError, UnknownNameError
from .._palette import BLACK, BLUE, GOAL, GREY, VERMILLION, WHITE
from ..learning import Learning
from ..learning._potential_choice import cosines
from ._plane import Plane, demonstration_plane, field_on_plane, fields_at
from ._style import (
    LABEL,
    LINE,
    MARKER,
    STAR,
    THICK,
    THIN,
    TICK,
    TITLE,
    Axes,
    Figure,
    label_axes,
    legend_below,
    new_figure,
)

_GRID = 101  # points along the longer side
_MARGIN = 0.15  # of the longer side


def vector_field_figure(learning: Learning, subtask: int = 0) -> Figure:
    """How a subtask would move from everywhere near its demonstrations, before and after the metric warps it.

    Left `-grad Phi`, right `-M^-1 grad Phi`, each with the contours of Phi and the mean cosine to the demonstrated
    directions, in the plane through the goal that holds most of the demonstrations.

    **Arguments**: `learning`, by `learn`; `subtask`, its index.
    **Returns** a matplotlib `Figure`.
    **Raises** `UnknownNameError` for an index that is not there; `ConfigurationError` for a flow, which has no field of
    a subtask; `MissingDependencyError` without matplotlib.

    Rana et al. 2019, figures 1b and 1c.
    """
    names = learning.skill.subtasks
    UnknownNameError.check("subtask index", subtask, range(len(names)))
    if learning.paper is None:
        raise ConfigurationError(
            "a flow moves the whole hand, and no subtask has a field. Learn with method = 'paper'."
        )
    learned = jax.tree.map(lambda a: a[subtask], learning.skill.learned)
    positions = learning.prepared.subtasks.positions[subtask]
    directions = learning.prepared.subtasks.directions[subtask]
    plane = demonstration_plane(positions)
    paths = plane.project(positions)
    field = field_on_plane(learned, plane, *_grid(paths))
    _, *at_demonstrations = fields_at(learned, positions)

    width, height = np.ptp(field.u), np.ptp(field.v)
    figure = new_figure(float(np.clip(3.1 * height / width, 1.6, 4.4)) + 1.7)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    titles = (r"potential alone, $-\nabla\Phi$", r"warped by the metric, $-M^{-1}\nabla\Phi$")
    low, high = field.potential.min(), field.potential.max()
    darkest = low - 1.3 * (high - low)  # only light greys, so that lines stand out
    for axes, title, flow, at in zip(panels, titles, (field.descent, field.warped), at_demonstrations, strict=True):
        contours = axes.contourf(field.u, field.v, field.potential, 18, cmap="Greys_r", vmin=darkest, vmax=high)
        axes.contour(field.u, field.v, field.potential, contours.levels, colors=WHITE, linewidths=THIN)
        axes.streamplot(
            field.u, field.v, flow[..., 0], flow[..., 1], color=GREY, linewidth=THIN, arrowsize=0.7, density=1.1
        )
        _demonstrations(axes, paths, learning.paper.nominal[subtask])
        cosine = cosines(at, directions, positions).mean()
        caption = f"{title}\nmean cosine to the demonstrations {cosine:.3f}"
        label_axes(axes, _axis_label(plane, 0), _axis_label(plane, 1), caption)
        axes.grid(False)
        axes.set(aspect="equal", xlim=field.u[[0, -1]], ylim=field.v[[0, -1]])
    panels[1].set_ylabel("")
    bar = figure.colorbar(contours, ax=panels, shrink=0.8, pad=0.02, format="%.2f")
    bar.ax.tick_params(labelsize=TICK)
    bar.set_label(r"potential $\Phi$ (m)", fontsize=LABEL)
    share = f"plane with {100 * plane.share:.1f} % of the demonstrations' spread"
    figure.suptitle(f"{learning.skill.configuration.name}, {names[subtask]}: {share}", fontsize=TITLE)
    legend_below(figure, panels[0])
    return figure


def _demonstrations(axes: Axes, paths: np.ndarray, nominal: int) -> None:
    others = [path for n, path in enumerate(paths) if n != nominal]
    for n, path in enumerate(others):
        axes.plot(*path.T, color=BLUE, linewidth=LINE, label="demonstrations" if n == 0 else None)
    axes.plot(*paths[nominal].T, color=VERMILLION, linewidth=THICK, label="nominal demonstration")
    starts = paths[:, 0].T
    axes.plot(*starts, "o", color=WHITE, markeredgecolor=BLACK, markersize=MARKER, label="starts", zorder=5)
    axes.plot(0, 0, "*", color=GOAL, markeredgecolor=BLACK, markersize=STAR, label="goal", zorder=6)


def _grid(paths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Even coordinates along both axes of the plane, around all paths and the goal."""
    points = np.concatenate([paths.reshape(-1, 2), np.zeros((1, 2))])
    size = np.ptp(points, axis=0).max()
    low, high = points.min(0) - _MARGIN * size, points.max(0) + _MARGIN * size
    counts = np.ceil((_GRID - 1) * (high - low) / (high - low).max()).astype(int) + 1
    return np.linspace(low[0], high[0], counts[0]), np.linspace(low[1], high[1], counts[1])


def _axis_label(plane: Plane, axis: int) -> str:
    components = ", ".join(f"{c:.2f}".replace("-", "\u2212") for c in plane.axes[axis])
    return f"position along\n({components}) (m)"
