"""Run one benchmark, print its table, and write its rows as JSON if asked."""

import argparse
import json
import os
import platform
from importlib.metadata import version
from pathlib import Path

from . import evaluation, latency, learning, physics, reproduction, scenes, tracker, viewer

BENCHMARKS = {
    "latency": latency.rows,
    "learning": learning.rows,
    "reproduction": reproduction.rows,
    "scenes": scenes.rows,
    "physics": physics.rows,
    "evaluation": evaluation.rows,
    "tracker": tracker.rows,
    "viewer": viewer.rows,
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure jaxrmp on this machine.")
    parser.add_argument("name", choices=BENCHMARKS)
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    rows = BENCHMARKS[arguments.name]()
    columns = list(dict.fromkeys(key for row in rows for key in row))
    table = [columns] + [[_text(row.get(column)) for column in columns] for row in rows]
    widths = [max(len(line[i]) for line in table) for i in range(len(columns))]
    for line in table:
        print(
            "  ".join(
                cell.rjust(width) if i else cell.ljust(width)
                for i, (cell, width) in enumerate(zip(line, widths, strict=True))
            )
        )
    if arguments.json:
        content = {
            "machine": f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()}",
            "versions": {name: version(name) for name in ("jaxrmp", "jax", "jaxlib", "numpy", "cvxpy", "mujoco")},
            "rows": rows,
        }
        arguments.json.write_text(json.dumps(content, indent=1) + "\n")


def _text(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


main()
