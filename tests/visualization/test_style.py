"""One style for all figures: the library's, the benchmarks', the notebooks', and what a user draws by pyplot."""

import ast
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from jaxrmp._palette import BLUE, SERIES, WHITE
from jaxrmp.visualization import figure_style
from jaxrmp.visualization._style import DPI, TALL, USUAL, WIDTH, label_axes, legend_below, new_figure, series_style

ROOT = Path(__file__).parents[2]
DRAWING = [p for folder in ("jaxrmp/visualization", "benchmarks") for p in sorted((ROOT / folder).glob("*.py"))]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))
LOOKS = {
    "fontsize",
    "labelsize",
    "linewidth",
    "linewidths",
    "lw",
    "markersize",
    "ms",
    "color",
    "colors",
    "dpi",
    "figsize",
}


def said(path: Path) -> list[tuple[str, object, int]]:
    """Arguments of calls in a file that are a number, a word or a tuple of them: name, value, line."""
    calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
    return [
        (keyword.arg or "", ast.unparse(keyword.value), call.lineno)
        for call in calls
        for keyword in call.keywords
        if isinstance(keyword.value, ast.Constant | ast.Tuple | ast.List)
    ]


@pytest.mark.parametrize("path", DRAWING, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_how_figures_look_is_said_in_one_place(path):
    if path.name == "_style.py":
        return
    own = [(name, value, line) for name, value, line in said(path) if name in LOOKS and value not in ("0", "'none'")]
    assert not own, "take it from jaxrmp.visualization._style or jaxrmp._palette"
    assert "matplotlib.figure" not in path.read_text(encoding="utf-8"), "make figures by new_figure"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebooks_draw_in_the_librarys_style(path):
    text = path.read_text(encoding="utf-8")
    assert "plt.rcParams.update(" in text and "figure_style()" in text
    assert not [entry for entry in said(path) if entry[0] in ("figsize", "dpi", "fontsize")]


def looks(figure) -> dict:
    figure.draw_without_rendering()
    (axes,) = figure.axes
    (line,) = axes.lines
    grid, tick = axes.get_xgridlines()[0], axes.get_xticklabels()[0]
    return {
        "size": (*figure.get_size_inches(), figure.dpi),
        "text": [a.get_size() for a in (axes.xaxis.label, axes.yaxis.label, axes.title, tick)],
        "line": (line.get_color(), line.get_linewidth()),
        "grid": (grid.get_visible(), grid.get_color(), grid.get_linewidth(), axes.get_axisbelow()),
        "frame": [axes.spines[side].get_visible() for side in ("left", "bottom", "top", "right")],
        "place": axes.get_position().bounds,
    }


def test_what_users_draw_looks_like_the_librarys_figures():
    import matplotlib
    from matplotlib.figure import Figure

    ours = new_figure()
    axes = ours.subplots()
    axes.plot([0, 1], [0, 1], **series_style(1)[0])
    label_axes(axes, "time (s)", "energy", "title")
    with matplotlib.rc_context(figure_style()):
        theirs = Figure()
        axes = theirs.subplots()
        axes.plot([0, 1], [0, 1])
        axes.set(xlabel="time (s)", ylabel="energy", title="title")
        found = looks(theirs)
    assert found == looks(ours)
    assert found["size"] == (WIDTH, USUAL, DPI) and found["line"][0] == BLUE


def test_files_are_as_wide_as_every_other(tmp_path):
    from matplotlib.image import imread

    for height in (USUAL, TALL, 2.0):
        new_figure(height).savefig(tmp_path / "figure.png")
        assert imread(tmp_path / "figure.png").shape[:2] == (round(height * DPI), WIDTH * DPI)


def test_long_titles_and_labels_stay_inside_their_panel():
    figure = new_figure()
    panels = figure.subplots(1, 3)
    for axes in panels:
        label_axes(axes, "a long name of what is measured (m)", "the largest of all speeds (rad/s)", "a title " * 6)
    figure.draw_without_rendering()
    titles = [axes.title.get_window_extent() for axes in panels]
    assert all(a.x1 < b.x0 for a, b in pairwise(titles))
    for axes in panels:
        box = axes.get_tightbbox()
        assert box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0 and box.y1 <= figure.bbox.y1


@pytest.mark.parametrize("count", [2, 9, 14])
def test_a_legend_is_inside_its_figure_and_below_all_panels(count):
    figure = new_figure()
    panels = figure.subplots(1, 2)
    for axes in panels:
        for k, style in enumerate(series_style(count)):
            axes.plot([0, 1], [0, k], label=f"demonstration {k}", **style)
    legend_below(figure, *panels)
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert len(figure.legends[0].get_texts()) == count  # each name once
    assert box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0
    assert box.y1 <= min(axes.get_tightbbox().y0 for axes in panels)


def test_no_two_of_many_series_look_alike():
    assert len({(s["color"], s["linestyle"]) for s in series_style(28)}) == 28


# What protanopes and deuteranopes see of linear RGB: Viénot, Brettel and Mollon 1999, in RGB from there and back.
DICHROMATS = {
    "protanope": [[0.1124, 0.8876, 0.0], [0.1124, 0.8876, 0.0], [0.0040, -0.0040, 1.0]],
    "deuteranope": [[0.2928, 0.7072, 0.0], [0.2928, 0.7072, 0.0], [-0.0223, 0.0223, 1.0]],
}


@pytest.mark.parametrize("eye", ["any", *DICHROMATS])
def test_colours_are_told_from_white_and_from_each_other(eye):
    linear = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in (*SERIES, WHITE)]) ** 2.2
    seen = np.clip(linear @ np.array(DICHROMATS.get(eye, np.eye(3))).T, 0, 1) ** (1 / 2.2)
    apart = np.linalg.norm(seen[:, None] - seen[None], axis=-1)[np.triu_indices(len(seen), 1)]
    assert apart.min() > 0.1
