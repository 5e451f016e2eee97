"""Why each potential has the kernel width it has."""

import numpy as np

from .._errors import ConfigurationError
from .._palette import BLACK, GOAL, GREY
from ..learning import Learning
from ._style import MARKERS, STAR, Figure, label_axes, legend_below, new_figure, series_style


def width_figure(learning: Learning) -> Figure:
    """What was measured with each kernel width tried, for every subtask in `learning`, and which one was chosen.

    Left the mean cosine between `-grad Phi` and the demonstrated directions; middle the share of samples beyond 90
    degrees of them; right the share of starts whose descent ends at the goal, for the widths it was measured for
    (the best so far). Widths whose convex program failed are crosses at the foot of the left panel.

    **Returns** a matplotlib `Figure`.
    **Raises** `ConfigurationError` for a flow, which has no potentials; `MissingDependencyError` without matplotlib.
    """
    if learning.paper is None:
        raise ConfigurationError("a flow has no potentials, and so no kernel widths. Learn with method = 'paper'.")
    figure = new_figure()
    panels = figure.subplots(1, 3)
    names, K = learning.skill.subtasks, len(learning.skill.subtasks)
    tried = sorted({100 * trial.width for choice in learning.paper.potentials for trial in choice.trials})
    gap = min(np.diff(tried), default=tried[0])
    failed: list[float] = []
    for k, (name, choice, style) in enumerate(zip(names, learning.paper.potentials, series_style(K), strict=True)):
        trials = sorted(choice.trials, key=lambda trial: trial.width)
        width = np.array([100 * trial.width for trial in trials])
        chosen = 100 * choice.trial.width
        failed += [100 * trial.width for trial in trials if trial.problem]
        measures = [[t.alignment for t in trials], [100 * t.beyond_90 for t in trials]]
        best = (choice.trial.alignment, 100 * choice.trial.beyond_90)
        # Hollow markers of different sizes, so that equal values show one inside the other.
        size = 5 + 2.5 * (K - 1 - k)
        marker = {"marker": MARKERS[k % len(MARKERS)], "markersize": size, "markerfacecolor": "none"}
        line = {**marker, **style}
        for axes, values, at in zip(panels, measures, best, strict=False):
            axes.plot(width, values, label=name, **line)
            axes.plot(chosen, at, "*", color=GOAL, markeredgecolor=style["color"], markersize=STAR, zorder=5)
        shares = [100 * t.basin.share_reached if t.basin else np.nan for t in trials]
        offset = 0.7 * gap * ((k + 0.5) / K - 0.5)
        panels[2].bar(width + offset, shares, 0.6 * gap / K, color=style["color"])
    if failed:
        foot = panels[0].get_xaxis_transform()
        panels[0].plot(failed, np.full(len(failed), 0.03), "x", color=GREY, transform=foot, label="could not be fitted")
    panels[0].plot([], [], "*", color=GOAL, markeredgecolor=BLACK, markersize=STAR, linestyle="", label="chosen")
    label_axes(panels[0], "kernel width (cm)", "mean cosine", "alignment with the demonstrations")
    label_axes(panels[1], "kernel width (cm)", "share of samples (%)", r"beyond 90° of the demonstrations")
    label_axes(panels[2], "kernel width (cm)", "share of starts (%)", "starts that reach the goal (best widths)")
    panels[1].set_ylim(-0.04 * max(panels[1].get_ylim()[1], 0.1), max(panels[1].get_ylim()[1], 0.1))
    panels[2].set_ylim(0, 105)
    for axes in panels:
        axes.set_xlim(tried[0] - 0.7 * gap, tried[-1] + 0.7 * gap)
        axes.set_xticks(tried, [f"{w:g}" for w in tried])
    legend_below(figure, panels[0])
    return figure
