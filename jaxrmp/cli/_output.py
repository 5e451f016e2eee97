"""Progress on the terminal, and files that say what made them."""

import contextlib
import json
import math
import platform
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from .._files import atomic_write
from ..learning import Configuration, configuration_to_dict

_PACKAGES = ("jaxrmp", "jax", "jaxlib", "numpy", "flax", "optax", "cvxpy", "clarabel", "mujoco")


@contextlib.contextmanager
def progress_bar(quiet: bool = False) -> Iterator[Callable[[str, float], None]]:
    """A function `(step, fraction)` that draws a bar for each step of a command; without a terminal, a line a step; if
    `quiet`, nothing."""
    if quiet:
        yield lambda step, fraction: None
        return
    if not sys.stderr.isatty():
        seen: set[str] = set()

        def tell(step: str, fraction: float) -> None:
            if step not in seen:
                seen.add(step)
                print(f"{step} ...", file=sys.stderr, flush=True)

        yield tell
        return
    from tqdm import tqdm

    layout = "{desc:<14} {percentage:3.0f} %|{bar}| {elapsed}"
    with tqdm(total=1.0, bar_format=layout, file=sys.stderr, leave=False) as bar:
        done = threading.Event()

        def show(step: str, fraction: float) -> None:
            bar.set_description_str(step, refresh=False)
            bar.n = fraction
            bar.refresh()

        def tick() -> None:  # the seconds go on where a step says nothing for long
            while not done.wait(0.5):
                bar.refresh()

        ticking = threading.Thread(target=tick, daemon=True)
        ticking.start()
        try:
            yield show
        finally:
            done.set()
            ticking.join()


def tell(message: str) -> None:
    """A line on stderr, above the progress bar if there is one."""
    tqdm = sys.modules.get("tqdm")
    with tqdm.tqdm.external_write_mode(file=sys.stderr) if tqdm else contextlib.nullcontext():
        print(f"jaxrmp: {message}", file=sys.stderr, flush=True)


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


_TURNS = "  position_percent  turn_deg  goal_turn_deg"
NOT_VALIDATED = "not validated: --validate learns with each demonstration left out in turn, and reproduces that one"


def validation_table(validation: dict[str, Any] | None) -> str:
    """Errors of demonstrations left out, beside the training's, a row a fold and one for the mean; or that there are
    none."""
    if validation is None:
        return NOT_VALIDATED
    turned = any(tells_turns(fold["held_out"]) for fold in validation["folds"])
    timed = (validation["training"] or {}).get("time_aligned_cm") is not None
    late, late_too = ("  time_aligned_cm", "  training_time_aligned_cm") if timed else ("", "")
    lines = [
        "each left out in turn, learned without it, and reproduced (held out), beside those learned from (training)",
        f"left_out  dtw_cm  frechet_cm  goal_cm{_TURNS * turned}{late}  training_dtw_cm  training_frechet_cm{late_too}"
        "  method",
    ]
    rows = [(str(f["left_out"]), f["held_out"], f["training"], f["method"]) for f in validation["folds"]]
    for name, held_out, training, method in [*rows, ("mean", validation["held_out"], validation["training"], "")]:
        if held_out is not None:
            lines.append(
                f"{name:<10}{held_out['dtw_cm']:>6.2f}{held_out['frechet_cm']:>12.2f}{held_out['goal_cm']:>9.3f}"
                + (_turns(held_out) if turned else "")
                + (f"{held_out['time_aligned_cm']:>17.2f}" if timed else "")
                + f"{training['dtw_cm']:>17.2f}{training['frechet_cm']:>21.2f}"
                + (f"{training['time_aligned_cm']:>26.2f}" if timed else "")
                + f"  {method}".rstrip()
            )
    lines += [fold_failed(f) for f in validation["folds"] if f["failed"]]
    lines.append(folds_passed(validation))
    return "\n".join(lines)


def tells_turns(errors: Mapping[str, Any] | None) -> bool:
    """Whether `errors` of a reproduction say how far the hand is turned off."""
    return errors is not None and errors.get("turn_deg") is not None


def _turns(errors: Mapping[str, Any]) -> str:
    """The cells of a row under `_TURNS`."""
    if not tells_turns(errors):
        return f"{'-':>18}{'-':>10}{'-':>15}"
    return f"{errors['position_percent']:>18.2f}{errors['turn_deg']:>10.2f}{errors['goal_turn_deg']:>15.2f}"


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
    turned = tells_turns(result["mean"])
    timed = result["mean"].get("time_aligned_cm") is not None
    late = "  time_aligned_cm" if timed else ""
    lines.append(f"demo    dtw_cm  frechet_cm  goal_cm{_TURNS * turned}  energy_increase  limit_margin_rad{late}")
    for name, e in [(str(e["demo"]), e) for e in result["per_demo"]] + [("mean", result["mean"])]:
        lines.append(
            f"{name:<6}{e['dtw_cm']:>8.2f}{e['frechet_cm']:>12.2f}{e['goal_cm']:>9.3f}"
            f"{_turns(e) if turned else ''}{e['energy_increase']:>17.1e}{e['limit_margin_rad']:>18.3f}"
            + (f"{e['time_aligned_cm']:>17.2f}" if timed else "")
        )
    for e in result["per_demo"]:
        if names := e["rests_away_from"]:
            lines.append(f"demo {e['demo']} comes to rest more than 1 cm away from the goal of {', '.join(names)}")
    return "\n".join(lines)
