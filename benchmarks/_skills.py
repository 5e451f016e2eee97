"""Skills to measure with, learned where they are not there yet."""

import os
from dataclasses import replace
from pathlib import Path

from jaxrmp.cli._sources import default_demonstrations, find_demonstrations
from jaxrmp.learning import Configuration, DemonstrationSet, Learning, learn, load_configuration, save_skill
from jaxrmp.learning._configuration import Method

from ._report import FOLDER

CONFIGS = Path(__file__).parent.parent / "configs"


def skill_file(task: str, source: str | None = None, quick: bool = False, method: Method = "auto") -> Path:
    """The skill of `configs/TASK.toml` with the committed settings, or of hardly any training if `quick`.

    `source`, `synthetic` or `recordings` (those in `$JAXRMP_DATA`): by default the latter where they are.
    """
    source = source or source_here(quick)
    file = FOLDER / f"{'quick_' if quick else ''}{source}_{task}_{method}" / f"{task}.skill.npz"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        save_skill(learned(task, source, quick, method).skill, file)
    return file


def learned(task: str, source: str, quick: bool = False, method: Method = "auto") -> Learning:
    """The outcome of learning a task."""
    settings = replace(configuration(task, quick), method=method)
    return learn(settings, settings.load_robot(), demonstrations(task, source))


def demonstrations(task: str, source: str):
    """The demonstrations of a task from a source."""
    folder = Path(os.environ.get("JAXRMP_DATA") or os.devnull) / "franka" / task
    return find_demonstrations(f"synthetic:{task}" if source == "synthetic" else str(folder))


def recorded(task: str) -> tuple[Configuration, DemonstrationSet]:
    """The recordings of a task in `$JAXRMP_DATA`, or what the command line has in their place, and its configuration:
    the committed one of that name, or the drawer's, whose control points are the same hand's."""
    file = CONFIGS / f"{task}.toml"
    settings = load_configuration(file if file.exists() else CONFIGS / "drawer_closing.toml")
    return replace(settings, name=task), find_demonstrations(default_demonstrations(task))


def configuration(task: str, quick: bool = False) -> Configuration:
    """The committed configuration of a task, cut down if `quick`."""
    settings = load_configuration(CONFIGS / f"{task}.toml")
    if not quick:
        return settings
    potential = replace(settings.potential, widths=(0.04,), basin_starts=50)
    flow = replace(settings.flow, updates=300)
    return replace(settings, flow=flow, metric=replace(settings.metric, updates=20), potential=potential)


def source_here(quick: bool = False) -> str:
    """The recordings, where they are; for a quick run always the synthetic demonstrations."""
    return "recordings" if os.environ.get("JAXRMP_DATA") and not quick else "synthetic"
