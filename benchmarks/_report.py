"""What a benchmark leaves behind: a table on the screen, rows as JSON."""

import datetime
import json
import math
import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

FOLDER = Path("out") / "benchmarks"
_PACKAGES = ("jaxrmp", "jax", "jaxlib", "numpy", "cvxpy", "mujoco", "mujoco-mjx", "torch", "pytorch_kinematics", "frax")


def table(rows: Sequence[dict[str, Any]], markdown: bool = False) -> str:
    """Rows under the union of their columns, without those that are empty in every row."""
    columns = list(dict.fromkeys(key for row in rows for key, value in row.items() if value is not None))
    lines = [columns] + [[_text(row.get(column)) for column in columns] for row in rows]
    if markdown:
        lines.insert(1, ["---"] * len(columns))
        return "\n".join("| " + " | ".join(line) + " |" for line in lines)
    widths = [max(len(line[i]) for line in lines) for i in range(len(columns))]
    return "\n".join(
        "  ".join(cell.rjust(w) if i else cell.ljust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True)))
        for line in lines
    )


def write_json(rows: Sequence[dict[str, Any]], file: Path, *, quick: bool, seconds: float) -> None:
    """Rows with what they were measured on and with; `load_average` is how busy the machine was when they were done."""
    content = {
        "machine": machine(),
        "versions": versions(),
        "date": datetime.datetime.now().isoformat(timespec="seconds"),
        "load_average": [round(load, 2) for load in os.getloadavg()] if hasattr(os, "getloadavg") else None,
        "seconds": round(seconds, 1),
        "quick": quick,
        "rows": [{name: _plain(value) for name, value in row.items()} for row in rows],
    }
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(content, indent=1) + "\n")


def _plain(value: Any) -> Any:
    """As JSON has it: a Python number, and null for one that is not finite."""
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def machine() -> str:
    """Processor, number of cores and system."""
    processor = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return f"{processor}, {platform.machine()}, {os.cpu_count()} cores, {platform.system()}"


def versions() -> dict[str, str]:
    """Versions of what is installed of the packages that benchmarks measure."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return str(value)
