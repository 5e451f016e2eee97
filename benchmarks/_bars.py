"""The bars that the benchmarks are held to, from the JSON that they left: measured, wanted, and which are met."""

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ._report import table

NAMES = (
    "latency",
    "control_loop",
    "throughput",
    "kinematics",
    "compilation",
    "peers",
    "export",
    "roofline",
    "machinery",
    "learning",
    "rollouts",
)
Found = dict[str, list[dict[str, Any]]]


class Bar(NamedTuple):
    """`what` is wanted; `measured`, from the rows of all benchmarks; `most` or `least`, what it may be."""

    what: str
    measured: Callable[[Found], float]
    most: float | None = None
    least: float | None = None
    unit: str = ""


def _of(benchmark: str, name: str, column: str) -> Callable[[Found], float]:
    def measured(found: Found) -> float:
        return next(row[column] for row in found[benchmark] if row["name"] == name)

    return measured


def _least_of(benchmark: str, start: str, column: str) -> Callable[[Found], float]:
    def measured(found: Found) -> float:
        return min(row[column] for row in found[benchmark] if row["name"].startswith(start))

    return measured


def _most_of(benchmark: str, column: str) -> Callable[[Found], float]:
    def measured(found: Found) -> float:
        return max(row[column] for row in found[benchmark] if column in row)

    return measured


def _at(start: str, size: int, column: str) -> Callable[[Found], float]:
    def measured(found: Found) -> float:
        rows = (row for row in found["throughput"] if row["name"].startswith(start) and row["size"] == size)
        return next(rows)[column]

    return measured


def _steepest(*families: str) -> Callable[[Found], float]:
    def measured(found: Found) -> float:
        rows = [row for row in found["throughput"] if row["name"].startswith(tuple(f"growth: {f}" for f in families))]
        return max(row["exponent"] for row in rows)

    return measured


BARS = (
    Bar("24 pairs, one call, median", _of("latency", "panda_24_pairs", "median_us"), most=45, unit="us"),
    Bar("24 pairs, one call, p99.9", _of("latency", "panda_24_pairs", "p999_us"), most=300, unit="us"),
    Bar(
        "24 pairs, faster than fabrics' exported C",
        _of("peers", "fabrics 0.10.0, exported C, gcc -O0", "times_ours"),
        least=6,
        unit="times",
    ),
    Bar(
        "24 pairs, faster than fabrics from Python",
        _of("peers", "fabrics 0.10.0, Python", "times_ours"),
        least=20,
        unit="times",
    ),
    Bar(
        "24 pairs in C, gcc -O2, faster than fabrics' exported C",
        _of("export", "24 pairs: C, gcc -O2", "than_fabrics"),
        least=40,
        unit="times",
    ),
    Bar(
        "24 pairs in C, from Python, faster than fabrics' exported C",
        _of("export", '24 pairs: compiled, backend="c"', "than_fabrics"),
        least=20,
        unit="times",
    ),
    Bar(
        "flow drawer, whole arm, in C, gcc -O3 -march=native, faster than compiled",
        _of("export", "flow drawer, whole arm: C, gcc -O3 -march=native", "times_faster"),
        least=3,
        unit="times",
    ),
    Bar("exported C, source", _most_of("export", "source_kb"), most=1000, unit="kB"),
    Bar("exported C, compiled", _most_of("export", "compile_s"), most=10, unit="s"),
    Bar("24 pairs, batch 1,024, an evaluation", _of("latency", "panda_24_pairs", "batch_1024_us"), most=2, unit="us"),
    Bar("the same over its counted operations", _of("roofline", "by hand, all", "times_limit"), most=10, unit="times"),
    Bar("learned drawer, one call, median", _of("latency", "learned_drawer", "median_us"), most=100, unit="us"),
    Bar(
        "learned drawer, batch 1,024, an evaluation",
        _of("latency", "learned_drawer", "batch_1024_us"),
        most=10,
        unit="us",
    ),
    Bar("Lula Franka, one call, median", _of("latency", "lula_franka", "median_us"), most=250, unit="us"),
    Bar(
        "pose and Jacobian, batch 4,096, faster than pytorch-kinematics",
        _of("kinematics", "pytorch-kinematics fk+jacobian", "times_ours"),
        least=10,
        unit="times",
    ),
    Bar(
        "pose and Jacobian, batch 4,096, faster than frax",
        _of("kinematics", "frax fk+jacobian", "times_ours"),
        least=1.5,
        unit="times",
    ),
    Bar(
        "training loop, faster than PyTorch",
        _least_of("learning", "metric loop, torch", "times_ours"),
        least=4,
        unit="times",
    ),
    Bar("growth with obstacles, 8 to 512, mapped 64 at a time", _steepest("obstacles"), most=1.05, unit="exponent"),
    Bar("growth with leaves, 4 to 64, mapped 64 at a time", _steepest("leaves, batched"), most=1.05, unit="exponent"),
    Bar(
        "30 joints, three arms, batch 256, an evaluation",
        _at("degrees of freedom, three arms, batch", 30, "us_per_evaluation"),
        most=20,
        unit="us",
    ),
    Bar(
        "30 joints, three arms, one call",
        _at("degrees of freedom, three arms, single", 30, "call_us"),
        most=150,
        unit="us",
    ),
    Bar(
        "30 joints, one arm, batch 256, an evaluation",
        _at("degrees of freedom, batch", 30, "us_per_evaluation"),
        most=20,
        unit="us",
    ),
    Bar("30 joints, one arm, one call", _at("degrees of freedom, single", 30, "call_us"), most=150, unit="us"),
    Bar(
        "growth with joints of three arms, 14 to 30", _steepest("degrees of freedom, three"), most=1.6, unit="exponent"
    ),
    Bar("growth with batch, 256 to 65,536, mapped 1,024 at a time", _steepest("batch"), most=1.05, unit="exponent"),
    Bar("learned policy, compiled from nothing", _of("compilation", "learned_drawer, cold", "compile_s"), 5, unit="s"),
    Bar("the same from the cache", _of("compilation", "learned_drawer, cached", "compile_s"), most=0.5, unit="s"),
    Bar(
        "retraces in a control loop of 10,000 steps",
        _of("control_loop", "moving_goal_door_obstacles", "retraces"),
        most=0,
    ),
)


def report(folder: Path) -> str:
    """A line a bar: what was measured, the bar, and whether it is met; `not measured` where there is no such row."""
    found = read(folder)
    quick = [name for name in found if json.loads((folder / f"{name}.json").read_text())["quick"]]
    warning = f"from quick runs, whose figures mean nothing: {', '.join(quick)}\n" if quick else ""
    return warning + table([_judged(bar, found) for bar in BARS])


def fill(text: str, folder: Path) -> str:
    """Text in which what stands between `<!-- table: NAME -->` and `<!-- end -->` is that table, measured last.

    NAME is `bars` or a benchmark. **Raises** `SystemExit` for a table that has not been measured, or only quickly.
    """
    return re.sub(
        r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)",
        lambda match: f"{match[1]}{markdown(match[2], folder)}\n{match[3]}",
        text,
        flags=re.DOTALL,
    )


def markdown(name: str, folder: Path) -> str:
    """One table as markdown, under the conditions that it was measured in."""
    if name == "bars":
        return table([_judged(bar, read(folder)) for bar in BARS], markdown=True)
    file = folder / f"{name}.json"
    if not file.exists():
        raise SystemExit(f"{file} is not there: python -m benchmarks {name}")
    content = json.loads(file.read_text())
    if content["quick"]:
        raise SystemExit(f"{file} is from a quick run, whose figures mean nothing: python -m benchmarks {name}")
    load = content["load_average"]
    conditions = (
        f"{content['date'][:16]}, {content['machine']}, load average {load[0] if load else 'unknown'}, took "
        f"{content['seconds']:.0f} s."
    )
    return f"{conditions}\n\n{table(_shown(content['rows']), markdown=True)}"


def read(folder: Path) -> Found:
    """The rows of all benchmarks that have been run."""
    files = {name: folder / f"{name}.json" for name in NAMES}
    return {name: json.loads(file.read_text())["rows"] for name, file in files.items() if file.exists()}


def _judged(bar: Bar, found: Found) -> dict[str, Any]:
    wanted = f"<= {bar.most:g}" if bar.most is not None else f">= {bar.least:g}"
    row: dict[str, Any] = {"bar": bar.what, "measured": None, "wanted": f"{wanted} {bar.unit}".strip()}
    try:
        value = bar.measured(found)
    except (KeyError, StopIteration, ValueError):
        return row | {"verdict": "not measured"}
    met = value <= bar.most if bar.most is not None else value >= (bar.least or 0)
    return row | {"measured": float(value), "verdict": "met" if met else "MISSED"}


def _shown(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Without the columns that repeat what a row is called."""
    return [{key: value for key, value in row.items() if key not in ("library", "task")} for row in rows]
