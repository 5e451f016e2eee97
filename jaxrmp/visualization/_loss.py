"""How the training of the metrics went."""

import numpy as np

from ..learning import Learning
from ._style import Figure, label_axes, legend_below, new_figure, series_style


def loss_figure(learning: Learning) -> Figure:
    """The loss of the flow in `learning`, or of every subtask's metric, against the training update.

    **Returns** a matplotlib `Figure`. **Raises** `MissingDependencyError` without matplotlib.

    Rana et al. 2019, section 3.2.
    """
    figure = new_figure()
    from matplotlib.ticker import LogLocator, NullFormatter

    axes = figure.subplots()
    losses, names = learning.losses, learning.skill.parts
    updates = np.arange(1, len(losses) + 1)
    for loss, name, style in zip(losses.T, names, series_style(len(names)), strict=True):
        axes.semilogy(updates, loss, label=name, **style)
    kind = {"smooth_l1": "Huber loss", "l2": "squared loss"}.get(learning.skill.configuration.metric.loss, "loss")
    what = "loss of the flow" if learning.paper is None else f"{kind} of the warped field"
    label_axes(axes, "update", what, learning.skill.configuration.name)
    axes.set_xlim(0, len(losses))
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    legend_below(figure, axes)
    return figure
