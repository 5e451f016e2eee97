"""What happened in trials in physics, over time."""

from typing import TYPE_CHECKING

import numpy as np

from ..simulation import Run
from ._style import BLACK, GREY, label_axes, new_figure, series_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def physics_figure(run: Run) -> "Figure":
    """The furniture's joint, and joint speeds and torques as shares of their limits, over time, of all trials of `run`.

    **Returns** a matplotlib `Figure`. **Raises** `MissingDependencyError` without matplotlib.
    """
    figure = new_figure(13.0, 4.0)
    left, middle, right = figure.subplots(1, 3)
    scene = run.scene
    limit = scene.model.actuator_ctrlrange[scene.arm_actuators, 1]
    address = scene.model.joint(scene.joint).qposadr[0]
    door = scene.name == "door"
    scale = np.degrees(1.0) if door else 1000.0
    for trace, style in zip(run.traces, series_style(len(run.traces)), strict=True):
        left.plot(trace.time, scale * trace.qpos[:, address], linewidth=1.1, **style)
        speed = np.abs(trace.qd) / np.asarray(scene.robot.velocity_limit)
        middle.plot(trace.time, speed.max(1), linewidth=1.1, **style)
        right.plot(trace.time, (np.abs(trace.torque) / limit).max(1), linewidth=1.1, **style)
    if not door:
        left.axhline(5.0, color=GREY, linewidth=0.8, linestyle="--")
    for axes in (middle, right):
        axes.axhline(1.0, color=BLACK, linewidth=0.8, linestyle="--")
        axes.set_ylim(bottom=0)
    label_axes(left, "time (s)", "door turned (degrees)" if door else "drawer open (mm)", f"scene {scene.name}")
    label_axes(middle, "time (s)", "largest joint speed, share of its limit")
    ended = f"{run.successes} of {len(run.outcomes)} trials succeeded"
    label_axes(right, "time (s)", "largest torque, share of its limit", ended)
    return figure
