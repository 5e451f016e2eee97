"""Run one benchmark, or all that `make bench` runs; print its table, write its rows as JSON and a plot beside it."""

import argparse
import importlib
import subprocess
import sys
import time
from pathlib import Path

from . import _bars
from ._children import stay_on_one_core
from ._report import FOLDER, table, write_json

ALL_CORES = ("learning", "rollouts")
ONE_CORE = tuple(name for name in _bars.NAMES if name not in ALL_CORES)
LONG = (
    "franka",
    "reproduction",
    "paths",
    "starts",
    "scenes",
    "robots",
    "balls",
    "view",
    "physics",
    "evaluation",
    "tracker",
    "perception",
    "depth",
    "viewer",
    "waits",
)  # what policies achieve, rather than how fast


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure jaxrmp on this machine.")
    parser.add_argument("name", choices=[*_bars.NAMES, *LONG, "all", "bars", "tables"])
    parser.add_argument("--json", type=Path, metavar="FILE", help="where to, by default out/benchmarks/NAME.json")
    parser.add_argument("--quick", action="store_true", help="hardly any repetitions, to see that it runs")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="of `all`, `bars` and `tables`: where the JSON is")
    parser.add_argument("documents", nargs="*", type=Path, metavar="FILE", help="for `tables`: markdown to fill in")
    arguments = parser.parse_args()
    if arguments.name == "all":
        return _all(arguments.folder, arguments.quick)
    if arguments.name == "bars":
        print(_bars.report(arguments.folder))
        return 0
    if arguments.name == "tables":
        for document in arguments.documents:
            document.write_text(_bars.fill(document.read_text(encoding="utf-8"), arguments.folder), encoding="utf-8")
        return 0
    if arguments.name in ONE_CORE:
        stay_on_one_core()
    run(arguments.name, arguments.json or arguments.folder / f"{arguments.name}.json", arguments.quick)
    return 0


def run(name: str, file: Path, quick: bool) -> None:
    """One benchmark, its table printed, its JSON in `file` and its plot beside that."""
    start = time.perf_counter()
    module = importlib.import_module(f"benchmarks.{name}")
    rows = module.rows() if name in LONG else module.rows(quick)
    device = _device()
    rows = [{**row, "device": row.get("device", device)} for row in rows]
    print(table(rows), flush=True)
    write_json(rows, file, quick=quick, seconds=time.perf_counter() - start)
    if hasattr(module, "figure"):
        module.figure(rows).savefig(file.with_suffix(".png"))


def _all(folder: Path, quick: bool) -> int:
    failed = []
    for name in _bars.NAMES:
        print(f"\n{name}", flush=True)
        command = [sys.executable, "-m", "benchmarks", name, "--json", str(folder / f"{name}.json")]
        if subprocess.run([*command, *(["--quick"] if quick else [])], check=False).returncode:
            failed.append(name)
    print("\n" + _bars.report(folder))
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return len(failed)


def _device() -> str:
    import jax

    return jax.devices()[0].device_kind


if __name__ == "__main__":
    sys.exit(main())
