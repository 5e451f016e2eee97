"""Progress on the terminal, and files that say what made them."""

import contextlib
import json
import math
import platform
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from .._files import atomic_write
from ..learning import Configuration, configuration_to_dict
from ..learning._progress import bar

_PACKAGES = ("jaxrmp", "jax", "jaxlib", "numpy", "flax", "optax", "cvxpy", "clarabel", "mujoco")


@contextlib.contextmanager
def progress_bar(quiet: bool = False) -> Iterator[Callable[[str, float], None]]:
    """A function `(step, fraction)` that draws a bar for each step of a command; without a terminal, or without tqdm, a
    line a step; if `quiet`, nothing."""
    if quiet:
        yield lambda step, fraction: None
        return
    if not sys.stderr.isatty() or find_spec("tqdm") is None:
        seen: set[str] = set()

        def tell(step: str, fraction: float) -> None:
            if step not in seen:
                seen.add(step)
                print(f"{step} ...", file=sys.stderr, flush=True)

        yield tell
        return
    with bar() as show:
        yield show


def tell(message: str) -> None:
    """A line on stderr, above the progress bar if there is one."""
    tqdm = sys.modules.get("tqdm")
    with tqdm.tqdm.external_write_mode(file=sys.stderr) if tqdm else contextlib.nullcontext():
        print(f"jaxrmp: {message}", file=sys.stderr, flush=True)


def clearance_in_words(trial: Mapping[str, Any], unit: str = "") -> str:
    """The least clearance of a trial, mm, or that there was nothing to check."""
    least = trial["min_clearance_m"]
    return f"{1000 * least:.1f}{unit}" if math.isfinite(least) else "not checked"


def write_json(content: Any, path: Path) -> None:
    """Write `content` as indented JSON, whole or not at all; a number that is not finite becomes null."""
    text = json.dumps(_without_nan(content), indent=1, allow_nan=False)
    with atomic_write(path) as file:
        file.write(text.encode() + b"\n")


def write_arrays(arrays: Mapping[str, Any], path: Path) -> None:
    """Write `arrays` as an NPZ file, whole or not at all."""
    with atomic_write(path) as file:
        np.savez_compressed(file, **arrays)


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_nan(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def made_by(command: str, configuration: Configuration, source: str) -> dict[str, Any]:
    """What made an output folder: command, configuration, demonstrations, versions of everything, machine."""
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return {
        "command": command,
        "seed": configuration.seed,
        "demonstrations": source,
        "configuration": configuration_to_dict(configuration),
        "versions": {"python": platform.python_version(), **versions},
        "machine": f"{platform.system()} {platform.machine()}",
    }


_PLACES = ("dtw_cm", "frechet_cm", "goal_cm")
SOME_MEASURE = {  # errors that not every skill has, by their key, with their heading on a page
    "position_percent": "place, % of the path",
    "turn_deg": "turn, degrees",
    "goal_turn_deg": "turn at the goal, degrees",
    "time_aligned_cm": "at the same time, cm",
}
NOT_VALIDATED = "not validated: --validate learns with each demonstration left out in turn, and reproduces that one"


def validation_table(validation: dict[str, Any] | None) -> str:
    """Errors of demonstrations left out, beside the training's, a row a fold and one for the mean; or that there are
    none."""
    if validation is None:
        return NOT_VALIDATED
    some = measured([fold["held_out"] for fold in validation["folds"]])
    late = [name for name in some if name == "time_aligned_cm"]
    kinds = {"held_out": [*_PLACES, *some], "training": [*_PLACES[:2], *late]}
    head = ["left_out", *kinds["held_out"], *(f"training_{name}" for name in kinds["training"]), "method"]
    named = [(str(fold["left_out"]), fold) for fold in validation["folds"]]
    rows = [
        [name, *(_number(fold[kind], key) for kind, keys in kinds.items() for key in keys), fold.get("method", "")]
        for name, fold in [*named, ("mean", validation)]
        if fold["held_out"] is not None
    ]
    lines = [
        "each left out in turn, learned without it, and reproduced (held out), beside those learned from (training)",
        *aligned(head, rows, of_words=1),
    ]
    lines += [fold_failed(f) for f in validation["folds"] if f["failed"]]
    lines.append(folds_passed(validation))
    return "\n".join(lines)


def measured(rows: Iterable[Mapping[str, Any] | None]) -> list[str]:
    """Those of `SOME_MEASURE` that a row of errors has, in order."""
    rows = list(rows)
    return [name for name in SOME_MEASURE if any(row is not None and row.get(name) is not None for row in rows)]


def aligned(head: Sequence[str], rows: Sequence[Sequence[str]], of_words: int = 0) -> list[str]:
    """The lines of a table, without the columns that say a dash in every row; the first column and the last `of_words`
    begin below one another, all others end so."""
    columns = [c for c in zip(head, *rows, strict=True) if not rows or any(cell != "-" for cell in c[1:])]
    widths = [max(map(len, column)) for column in columns]
    left = [k == 0 or k >= len(columns) - of_words for k in range(len(columns))]
    lines = zip(*columns, strict=True)
    return [
        "  ".join(
            cell.ljust(w) if to else cell.rjust(w) for cell, w, to in zip(line, widths, left, strict=True)
        ).rstrip()
        for line in lines
    ]


def _number(errors: Mapping[str, Any], name: str) -> str:
    """The error `name`, a dash where there is none."""
    value = errors.get(name)
    return "-" if value is None else f"{value:.{3 if name == 'goal_cm' else 2}f}"


def fold_failed(fold: Mapping[str, Any]) -> str:
    """Why a fold of a validation failed, in words."""
    return f"without demonstration {fold['left_out']} (the others numbered anew) learning failed: {fold['failed']}"


def folds_passed(validation: Mapping[str, Any]) -> str:
    """What the means of a validation are over, in words."""
    return f"validated: the means are over the {validation['passed']} of {len(validation['folds'])} folds that passed"


def error_table(result: dict[str, Any]) -> str:
    """Reproduction errors as a table, one row a demonstration and one for the mean, between what they are about and the
    goals missed."""
    lines = []
    if result["learned_from"] != result["measured_on"]:
        lines.append(f"note: learned from {result['learned_from']}, measured on other demonstrations")
    lines.append(f"measured on {result['measured_on']}")
    some = [*_PLACES, *measured(result["per_demo"])]
    rows = [
        [name, *(_number(e, key) for key in some), f"{e['energy_increase']:.1e}", f"{e['limit_margin_rad']:.3f}"]
        for name, e in [(str(e["demo"]), e) for e in result["per_demo"]] + [("mean", result["mean"])]
    ]
    lines += aligned(["demo", *some, "energy_increase", "limit_margin_rad"], rows)
    if all(e["goal_cm"] is None for e in result["per_demo"]):
        lines.append("a turn alone was learned, which has no place: no distances in cm")
    for e in result["per_demo"]:
        if names := e["rests_away_from"]:
            lines.append(f"demo {e['demo']} comes to rest more than 1 cm away from the goal of {', '.join(names)}")
    return "\n".join(lines)
