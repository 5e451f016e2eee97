"""What happened in trials in physics, over time."""

import numpy as np

from .._palette import BLACK, GREY
from ..simulation import Run
from ._style import THIN, Figure, label_axes, legend_below, new_figure, series_style

_NAMED = 8  # of more trials, which is which is not told


def physics_figure(run: Run) -> Figure:
    """What the scene has plotted, if anything, the joint speeds and the torques as shares of their limits, over time,
    for every trial of `run`, named where they are few.

    **Returns** a matplotlib `Figure`. **Raises** `MissingDependencyError` without matplotlib.
    """
    figure = new_figure()
    scene, plotted = run.scene, run.scene.plotted
    *left, middle, right = figure.subplots(1, 2 if plotted is None else 3)
    named = len(run.traces) <= _NAMED
    for k, (trace, style) in enumerate(zip(run.traces, series_style(len(run.traces)), strict=True)):
        if plotted is not None:
            address = scene.model.joint(scene.joint).qposadr[0]
            left[0].plot(trace.time, plotted.scale * trace.qpos[:, address], **style)
        label = f"trial {k}" if named else None
        speed = np.abs(trace.qd) / np.asarray(scene.robot.velocity_limit)
        middle.plot(trace.time, speed.max(1), label=label, **style)
        right.plot(trace.time, (np.abs(trace.torque) / scene.torque_limit).max(1), **style)
    if plotted is not None:
        if plotted.goal is not None:
            left[0].axhline(plotted.goal, color=GREY, linewidth=THIN, linestyle="--")
        label_axes(left[0], "time (s)", plotted.label, f"scene {scene.name}")
    for axes in (middle, right):
        axes.axhline(1.0, color=BLACK, linewidth=THIN, linestyle="--")
        axes.set_ylim(bottom=0)
    label_axes(middle, "time (s)", "largest joint speed,\nshare of its limit")
    ended = f"{run.successes} of {len(run.outcomes)} trials succeeded"
    label_axes(right, "time (s)", "largest torque,\nshare of its limit", ended)
    legend_below(figure, middle)
    return figure
