"""Figures as files."""

import io
import os
import re
from pathlib import Path

from .._files import atomic_write
from ..learning import Learning, PreparedDemonstrations, Reproduction
from ..simulation import Run
from ._energy import energy_figure
from ._loss import loss_figure
from ._physics import physics_figure
from ._style import Figure
from ._triangles import triangle_figure
from ._vector_field import vector_field_figure
from ._video import snapshots
from ._widths import width_figure


def save_learning_figures(learning: Learning, folder: str | os.PathLike) -> list[Path]:
    """Write the figures of `learning` to `folder`, made if need be: training losses, and by the paper's method fields
    and kernel widths.

    **Returns** the paths of the PNG files, none of them ever half written.
    **Raises** `MissingDependencyError` without matplotlib.
    """
    folder = Path(folder)
    paths = []
    if learning.paper is not None:
        for k, name in enumerate(learning.skill.subtasks):
            safe = re.sub(r"[^\w-]+", "_", name)
            paths.append(_save(vector_field_figure(learning, k), folder / f"vector_field_{k}_{safe}.png"))
        paths.append(_save(width_figure(learning), folder / "kernel_width.png"))
    paths.append(_save(loss_figure(learning), folder / "loss.png"))
    return paths


def save_reproduction_figures(
    prepared: PreparedDemonstrations, reproduction: Reproduction, folder: str | os.PathLike
) -> list[Path]:
    """Write the figures of `reproduction` to `folder`, made if need be: paths in space, and energy over time.

    `prepared`, the demonstrations. **Returns** the paths of the PNG files, none of them ever half written.
    **Raises** `MissingDependencyError` without matplotlib, and what `triangle_figure` raises.
    """
    folder = Path(folder)
    return [
        _save(triangle_figure(prepared, reproduction), folder / "triangles.png"),
        _save(energy_figure(reproduction), folder / "energy.png"),
    ]


def save_physics_figures(
    run: Run, prepared: PreparedDemonstrations, reproduction: Reproduction | None, folder: str | os.PathLike
) -> list[Path]:
    """Write the figures of `run` to `folder`, made if need be: joints, speeds and torques; snapshots; paths in space.

    `reproduction`, the first trials against the demonstrations, `prepared`, that they start from, or None.
    **Returns** the paths of the PNG files. **Raises** `MissingDependencyError`, and what `snapshots` raises.
    """
    from matplotlib.image import imsave

    folder = Path(folder)
    paths = [_save(physics_figure(run), folder / "physics.png")]
    with atomic_write(folder / "snapshots.png") as file:
        imsave(file, snapshots(run), format="png")
    paths.append(folder / "snapshots.png")
    if reproduction is not None:
        paths.append(_save(triangle_figure(prepared, reproduction), folder / "triangles_in_physics.png"))
    return paths


def png(figure: Figure) -> bytes:
    """`figure` as the bytes of a PNG file, for a page."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def _save(figure: Figure, path: Path) -> Path:
    with atomic_write(path) as file:
        figure.savefig(file, format="png")
    return path
