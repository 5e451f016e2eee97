"""What all figures share: width, heights, colours, lines, axes, legends.

`Figure` objects without pyplot: no display, no global state. Other modules draw by these names alone.
"""

import textwrap
from typing import TYPE_CHECKING, Any

from .._errors import importing
from .._palette import SERIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
    from mpl_toolkits.mplot3d import Axes3D as Axes3D
else:
    Axes = Axes3D = Figure = Any  # for annotations alone: matplotlib is imported where it draws

# Inches: the width of all, for a column of the docs; heights of a row of panels, of one with equal scales, of two rows.
WIDTH, USUAL, SQUARE, TALL = 8.0, 3.6, 4.6, 6.2
DPI = 150
TITLE, LABEL, TICK, NOTE = 10.5, 10.0, 9.0, 8.0  # points
LINE, THICK, THIN = 1.3, 2.4, 0.8  # points
MARKER, STAR = 5.0, 13.0  # points
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

_GRID, _GRID_LINE, _PAD = "#DDDDDD", 0.6, 0.08
_EM, _HANDLE = 0.0078, 0.65  # inches: of a letter for each point of its size; of an entry of a legend beside its name
_BESIDE, _ABOVE = 0.5, 1.3  # inches of a panel that its labels beside, and above and below, take
_DASHES = ("-", "--", ":", "-.")


def new_figure(height: float = USUAL) -> Figure:
    """An empty figure of that height in inches, laid out so that nothing overlaps.

    **Raises** `MissingDependencyError` without matplotlib.
    """
    with importing("matplotlib", "plots"):
        from matplotlib.figure import Figure
    figure = Figure(figsize=(WIDTH, height), dpi=DPI, layout="constrained")
    figure.get_layout_engine().set(w_pad=_PAD, h_pad=_PAD)  # type: ignore[union-attr]
    return figure


def figure_style() -> dict[str, Any]:
    """matplotlib's settings by which figures of your own, drawn by pyplot, look like the library's.

    Width and heights, resolution, text, lines, grid, and colours that are told apart with any colour vision:
    `plt.rcParams.update(figure_style())`, or `with plt.rc_context(figure_style()): ...` for some figures alone.

    **Returns** names and values of `matplotlib.rcParams`.
    """
    return {
        "figure.figsize": (WIDTH, USUAL),
        "figure.dpi": DPI,
        "savefig.dpi": "figure",
        "figure.constrained_layout.use": True,
        "figure.constrained_layout.w_pad": _PAD,
        "figure.constrained_layout.h_pad": _PAD,
        "figure.titlesize": TITLE,
        "axes.titlesize": TITLE,
        "axes.labelsize": LABEL,
        "xtick.labelsize": TICK,
        "ytick.labelsize": TICK,
        "legend.fontsize": TICK,
        "legend.frameon": False,
        "lines.linewidth": LINE,
        "lines.markersize": MARKER,
        "axes.prop_cycle": f"cycler('color', {list(SERIES)})",
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": _GRID,
        "grid.linewidth": _GRID_LINE,
        "axes.spines.top": False,
        "axes.spines.right": False,
    }


def series_style(count: int) -> list[dict]:
    """Line styles for `count` series: seven colours, then the same again dashed, dotted and dash-dotted."""
    return [
        {"color": SERIES[i % len(SERIES)], "linestyle": _DASHES[i // len(SERIES) % len(_DASHES)], "linewidth": LINE}
        for i in range(count)
    ]


def label_axes(axes: Axes, x: str, y: str, title: str = "") -> None:
    """Labels and a title, in lines that fit the panel, and a light grid."""
    spec = axes.get_subplotspec()
    rows, columns = spec.get_gridspec().get_geometry() if spec else (1, 1)
    width, height = WIDTH / columns, axes.figure.get_figheight() / rows  # pyright: ignore[reportAttributeAccessIssue]
    axes.set_xlabel(_in_lines(x, width - _BESIDE, LABEL), fontsize=LABEL)
    axes.set_ylabel(_in_lines(y, height - _ABOVE, LABEL), fontsize=LABEL)
    axes.set_title(_in_lines(title, width - _BESIDE, TITLE), fontsize=TITLE)
    axes.tick_params(labelsize=TICK)
    axes.grid(True, color=_GRID, linewidth=_GRID_LINE)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def legend_below(figure: Figure, *panels: Axes) -> None:
    """One legend for the whole figure under its axes, where there is no data: each name of `panels` once."""
    entries = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if not entries:
        return
    inches = [_HANDLE + _EM * TICK * len(label) for label in entries]
    rows = 1 if sum(inches) < WIDTH else -(-len(entries) // max(int(WIDTH / max(inches)), 1))
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside lower center",
        ncols=-(-len(entries) // rows),
        frameon=False,
        fontsize=TICK,
    )


def _in_lines(text: str, inches: float, size: float) -> str:
    """`text` broken into lines of that length; formulas are left whole."""
    letters = max(int(inches / (_EM * size)), 1)
    return "\n".join(line if "$" in line else textwrap.fill(line, letters) for line in text.split("\n"))
