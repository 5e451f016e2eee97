"""What came of many starts, in pictures."""

import numpy as np

from .._palette import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILLION
from ..evaluation import KINDS, Evaluation, regions
from ..simulation import End
from ._style import LINE, MARKER, SQUARE, Figure, label_axes, legend_below, new_figure

_COLOURS = {
    End.CONVERGED: BLUE,
    End.STOPPED_AT_LIMIT: ORANGE,
    End.HELD_BY_CONTACT: PURPLE,
    End.SPURIOUS: VERMILLION,
    End.UNFINISHED: GREY,
    End.DIVERGED: GREEN,
}


def evaluation_figures(evaluation: Evaluation) -> dict[str, tuple[Figure, str]]:
    """Figures of `evaluation`, by their headings, each with a sentence on what it shows.

    **Raises** `MissingDependencyError` without matplotlib.
    """
    return {
        "How rollouts end, by where the hand started": (
            _starts_figure(evaluation),
            "The first control point at the start, from above and from the side, coloured by how it ended.",
        ),
        "How rollouts end, by region": (_regions_figure(evaluation), "Share of each region's starts."),
        "How long it takes": (_times_figure(evaluation), "Share of all starts that have converged by then."),
        "Energy, clearance and joint limits": (
            _worst_figure(evaluation),
            "On each rollout: the largest rise of V above its least value before, relative to V's range; the smallest "
            "distance to the arm itself and the scene; the smallest distance of a joint to its limits.",
        ),
    }


def _starts_figure(evaluation: Evaluation) -> Figure:
    figure = new_figure(SQUARE)
    views = figure.subplots(1, 2)
    hand, kind = evaluation.start_hand, evaluation.ends.kind
    for axes, (i, j), names in zip(views, ((0, 1), (0, 2)), (("x (m)", "y (m)"), ("x (m)", "z (m)")), strict=True):
        for end, name in KINDS.items():  # the rare kinds on top
            members = kind == end
            if members.any():
                size = MARKER if end == End.CONVERGED else 4 * MARKER
                axes.scatter(hand[members, i], hand[members, j], size, _COLOURS[end], label=name.replace("_", " "))
        label_axes(axes, *names)
        axes.set_aspect("equal")
    legend_below(figure, views[0])
    return figure


def _regions_figure(evaluation: Evaluation) -> Figure:
    found = list(regions(evaluation.start_hand, evaluation.start_error))
    figure = new_figure(0.8 + 0.4 * len(found))
    axes = figure.subplots()
    left = np.zeros(len(found))
    names = [f"{name} ({members.sum()})" for name, members in found]
    for end, name in KINDS.items():
        share = np.array([(evaluation.ends.kind[members] == end).mean() for _, members in found])
        if share.any():
            axes.barh(names, 100 * share, left=100 * left, color=_COLOURS[end], label=name.replace("_", " "))
            left += share
    label_axes(axes, "share of starts (%)", "")
    axes.invert_yaxis()
    legend_below(figure, axes)
    return figure


def _times_figure(evaluation: Evaluation) -> Figure:
    figure = new_figure()
    axes = figure.subplots()
    times = np.sort(evaluation.seconds[evaluation.ends.kind == End.CONVERGED])
    share = 100 * np.arange(1, len(times) + 1) / len(evaluation.starts)
    axes.plot(np.append(0, times), np.append(0, share), color=BLUE, linewidth=LINE, drawstyle="steps-post")
    axes.set_ylim(0, 100)
    label_axes(axes, "time (s)", "converged (% of starts)")
    return figure


def _worst_figure(evaluation: Evaluation) -> Figure:
    figure = new_figure()
    rise, clearance, margin = figure.subplots(1, 3)
    track = evaluation.outcomes.track
    increase = evaluation.energy_increase
    increase = np.log10(np.clip(increase[np.isfinite(increase)], 1e-9, None))
    for axes, values, name in (
        (rise, increase, "log10 of energy increase"),
        (clearance, track.clearance, "smallest clearance (m)"),
        (margin, track.margin, "smallest distance to a limit (rad)"),
    ):
        values = np.asarray(values[np.isfinite(values)], float)
        if len(values):
            middle = (values.max() + values.min()) / 2
            half = max(np.ptp(values), 1e-3 * max(abs(middle), 1e-3)) / 2  # those that differ by rounding are one
            axes.hist(values, bins=60, range=(middle - half, middle + half), color=BLUE)
        axes.set_yscale("symlog")
        label_axes(axes, name, "rollouts")
    return figure
