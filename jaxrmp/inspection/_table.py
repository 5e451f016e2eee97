"""An inspection to read in a terminal."""

import numpy as np

from .._errors import ShapeError
from ._inspect import Inspection

_HEADINGS = ("leaf", "force", "metric", "|acceleration|", "gap", "energy", "dissipation")


def table(inspection: Inspection, rows: int = 20) -> str:
    """The leaves with the greatest share of the force first; those marked `*` void the certificate.

    **Arguments**: `inspection`, of one state; `rows`, how many leaves to show, the rest in one last line.
    **Returns** lines of text: shares of force and metric at the root, the length of the leaf's part of the
    acceleration, its gap (of the rest, the least), energy and dissipation per second.
    **Raises** `ShapeError` for an inspection of many states.
    """
    share = np.asarray(inspection.force_share, float)
    if share.ndim != 1:
        raise ShapeError(
            f"a table shows one state, and this inspection has leading axes {share.shape[:-1]}. Pick one with "
            "jax.tree.map(lambda a: a[t], inspection), or draw all with visualization.inspection_figure."
        )
    metric = np.asarray(inspection.metric_share, float)
    numbers = [np.linalg.norm(np.asarray(inspection.acceleration, float), axis=-1)]
    numbers += [np.asarray(a, float) for a in (inspection.gap, inspection.energy, inspection.dissipation)]
    order = np.lexsort((-metric, -share))
    shown, rest = order[:rows], order[rows:]
    lines = [_HEADINGS]
    for i in shown:
        name = inspection.names[i] + ("" if inspection.certified[i] else " *")
        lines.append((name, _percent(share[i]), _percent(metric[i]), *(f"{column[i]:.4g}" for column in numbers)))
    if rest.size:
        part = np.linalg.norm(np.asarray(inspection.acceleration, float)[rest].sum(0))
        sums = (f"{column[rest].sum():.4g}" for column in numbers[2:])
        closest = f"{np.fmin.reduce(numbers[1][rest]):.4g}"
        name = f"{rest.size} more"
        lines.append((name, _percent(share[rest].sum()), _percent(metric[rest].sum()), f"{part:.4g}", closest, *sums))
    widths = [max(len(line[k]) for line in lines) for k in range(len(_HEADINGS))]
    text = []
    for first, *others in lines:
        cells = [first.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))]
        text.append("  ".join(cells))
    if not all(inspection.certified):
        text.append("* no geometric dynamical system: voids the certificate")
    return "\n".join(text)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
