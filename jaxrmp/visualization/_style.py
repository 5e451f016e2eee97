"""What all figures share: colours, axes, legends. `Figure` objects without pyplot: no display, no global state."""

from typing import TYPE_CHECKING, Any

from .._errors import importing

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
    from mpl_toolkits.mplot3d import Axes3D as Axes3D
else:
    Axes = Axes3D = Figure = Any  # for annotations alone: matplotlib is imported where it draws

# Okabe and Ito's palette, told apart with any colour vision; its yellow, too light for lines, is kept for the goal.
BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
BLACK, GOAL, GREY = "#000000", "#F0E442", "#55616B"
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

_SERIES = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK)
_TITLE, _LABEL, _TICK = 11, 11, 9.5


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of that size in inches, laid out so that nothing overlaps.

    **Raises** `MissingDependencyError` without matplotlib.
    """
    with importing("matplotlib", "plots"):
        from matplotlib.figure import Figure
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.08)  # type: ignore[union-attr]
    return figure


def series_style(count: int) -> list[dict]:
    """Line styles for `count` series: seven colours, then the same again dashed, dotted and dash-dotted."""
    dashes = ("-", "--", ":", "-.")
    return [{"color": _SERIES[i % 7], "linestyle": dashes[i // 7 % 4]} for i in range(count)]


def label_axes(axes: Axes, x: str, y: str, title: str = "") -> None:
    """Labels, a title and a light grid."""
    axes.set_xlabel(x, fontsize=_LABEL)
    axes.set_ylabel(y, fontsize=_LABEL)
    axes.set_title(title, fontsize=_TITLE)
    axes.tick_params(labelsize=_TICK)
    axes.grid(True, color="#DDDDDD", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def legend_below(figure: Figure, axes: Axes) -> None:
    """One legend for the whole figure under its axes, where there is no data."""
    handles, labels = axes.get_legend_handles_labels()
    entry = 0.6 + 0.08 * max(len(label) for label in labels)  # inches at this font size
    rows = -(-len(labels) // max(int(figure.get_figwidth() / entry), 1))
    columns = -(-len(labels) // rows)
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=_LABEL - 1)
