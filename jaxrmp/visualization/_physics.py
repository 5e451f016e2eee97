"""What happened in trials in physics, over time."""

import numpy as np

from ..simulation import Run
from ._style import BLACK, GREY, Figure, label_axes, new_figure, series_style


def physics_figure(run: Run) -> Figure:
    """What the scene has plotted, if anything, the joint speeds and the torques as shares of their limits, over time,
    for every trial of `run`.

    **Returns** a matplotlib `Figure`. **Raises** `MissingDependencyError` without matplotlib.
    """
    figure = new_figure(13.0, 4.0)
    scene, plotted = run.scene, run.scene.plotted
    *left, middle, right = figure.subplots(1, 2 if plotted is None else 3)
    for trace, style in zip(run.traces, series_style(len(run.traces)), strict=True):
        if plotted is not None:
            address = scene.model.joint(scene.joint).qposadr[0]
            left[0].plot(trace.time, plotted.scale * trace.qpos[:, address], linewidth=1.1, **style)
        speed = np.abs(trace.qd) / np.asarray(scene.robot.velocity_limit)
        middle.plot(trace.time, speed.max(1), linewidth=1.1, **style)
        right.plot(trace.time, (np.abs(trace.torque) / scene.torque_limit).max(1), linewidth=1.1, **style)
    if plotted is not None:
        if plotted.goal is not None:
            left[0].axhline(plotted.goal, color=GREY, linewidth=0.8, linestyle="--")
        label_axes(left[0], "time (s)", plotted.label, f"scene {scene.name}")
    for axes in (middle, right):
        axes.axhline(1.0, color=BLACK, linewidth=0.8, linestyle="--")
        axes.set_ylim(bottom=0)
    label_axes(middle, "time (s)", "largest joint speed, share of its limit")
    ended = f"{run.successes} of {len(run.outcomes)} trials succeeded"
    label_axes(right, "time (s)", "largest torque, share of its limit", ended)
    return figure
