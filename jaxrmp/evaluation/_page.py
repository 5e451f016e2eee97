"""The report as one page that needs nothing else: figures inside, readable without the library."""

import base64
import html
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .._files import atomic_write
from ._report import KINDS

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1b1f23; max-width: 68rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; margin: 0.5rem 0 1.5rem; }
th, td { text-align: right; padding: 0.2rem 0.8rem; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; }
img { max-width: 100%; height: auto; }
figure { margin: 1.5rem 0; }
figcaption { color: #55616b; }
"""


def write_page(
    report: Mapping[str, Any], figures: Mapping[str, tuple[bytes, str]], path: str | os.PathLike, *, title: str
) -> Path:
    """Write the page; it appears whole or not at all.

    **Arguments**: `report`, as `report` gives it, with `settings` and `made_by` if there are; `figures`, for each
    heading a PNG picture and what it shows.
    """
    path = Path(path)
    with atomic_write(path) as file:
        file.write(_page(report, figures, title).encode())
    return path


def _page(report: Mapping[str, Any], figures: Mapping[str, tuple[bytes, str]], title: str) -> str:
    parts = [f"<h1>{html.escape(title)}</h1>", _summary(report)]
    for heading, (png, caption) in figures.items():
        data = base64.b64encode(png).decode()
        parts.append(
            f'<h2>{html.escape(heading)}</h2><figure><img alt="{html.escape(heading)}" '
            f'src="data:image/png;base64,{data}"><figcaption>{html.escape(caption)}</figcaption></figure>'
        )
    parts += [
        "<h2>By start region</h2>",
        _table(
            ["region", "starts", *(name.replace("_", " ") for name in KINDS.values()), "median time, s"],
            [
                [r["region"], r["starts"], *(_percent(r[name]) for name in KINDS.values()), _median(r)]
                for r in report["regions"]
            ],
        ),
        "<h2>Rest points away from the goal</h2>",
        _table(
            ["share", "distance of the worst control point, m", "joints", "starts"],
            [
                [_percent(p["share"]), f"{p['error_m']:.3f}", _numbers(p["joints"]), _numbers(p["starts"][:5], 0)]
                for p in report["spurious_rest_points"]
            ],
            "None was found.",
        ),
        "<h2>Stops at joint limits</h2>",
        _table(
            ["joint", "share", "largest distance to the limit, rad", "median distance to the goal, m"],
            [
                [p["joint"], _percent(p["share"]), f"{p['max_margin_rad']:.3f}", f"{p['median_error_m']:.3f}"]
                for p in report["limit_stops"]
            ],
            "None.",
        ),
        _stability(report["stability"]),
        f"<h2>Failing starts ({report['failing_starts']})</h2>",
        "<p>Replay one by its index: <code>jaxrmp evaluate SKILL ... --replay INDEX</code>, all else as here.</p>",
        _table(
            ["start", "end", "error, m", "time, s"],
            [[f["start"], f["end"], f"{f['error_m']:.3f}", f"{f['seconds']:.1f}"] for f in report["failing"][:200]],
            "None.",
        ),
    ]
    for name in ("settings", "made_by"):
        if name in report:
            parts.append(f"<h2>{name.replace('_', ' ').capitalize()}</h2>{_nested(report[name])}")
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body>{''.join(parts)}</body></html>\n"
    )


def _summary(report: Mapping[str, Any]) -> str:
    rows = [["starts", report["starts"]]]
    rows += [[name.replace("_", " "), _percent(report[name])] for name in KINDS.values()]
    times = report["time_to_converge_s"]
    if times:
        rows.append(["time to converge: median, 95 %, longest, s", _numbers(times.values(), 1)])
    rows += [
        ["non-finite", report["non_finite"]],
        ["largest energy increase, of V's range", f"{report['max_energy_increase']:.1e}"],
        ["smallest clearance, m", f"{report['min_clearance_m']:.3f}"],
        ["starts that touched something", report["starts_that_touched"]],
        ["smallest distance to a joint limit, rad", f"{report['min_limit_margin_rad']:.4f}"],
        ["starts that crossed a limit", report["starts_that_crossed_a_limit"]],
        ["fastest joint, rad/s", f"{report['max_joint_speed_rad_s']:.2f}"],
    ]
    return _table(["", ""], rows)


def _stability(found: Mapping[str, Any]) -> str:
    certificate = found["certificate"]
    rows = [
        [
            s["name"],
            f"{s['metric']['least_eigenvalue']:.3g} to {s['metric']['largest_eigenvalue']:.3g}",
            _percent(s["metric"]["positive_definite_share"]),
            f"{s['goal']['slope']:.1e}",
            _numbers(s["goal"]["hessian_eigenvalues"], 1),
            len(s.get("stationary_points", ())),
        ]
        for s in found["subtasks"]
    ]
    stationary = [
        [s["name"], p["kind"], f"{p['distance_m']:.4f}", _numbers(p["position"]), _numbers(p["eigenvalues"], 2)]
        for s in found["subtasks"]
        for p in s.get("stationary_points", ())
    ]
    uncertified = ", ".join(certificate["uncertified_leaves"]) or "none"
    return "".join(
        [
            "<h2>Stability</h2>",
            f"<p>Leaves without a certificate: {html.escape(uncertified)}. Along all rollouts, dV/dt differs from "
            f"minus the dissipation by at most {certificate['max_residual']:.1e} (1 + |V|) per second, and is at most "
            f"{certificate['max_growth_rate']:.1e} (1 + |V|) per second.</p>",
            _table(
                [
                    "subtask",
                    "metric's eigenvalues over the region",
                    "positive definite",
                    "slope at the goal",
                    "Hessian's eigenvalues at the goal, 1/m",
                    "stationary points",
                ],
                rows,
            ),
            _table(
                ["subtask", "kind", "distance from the goal, m", "position, m", "Hessian's eigenvalues, 1/m"],
                stationary,
                "Stationary points were not looked for.",
            ),
        ]
    )


def _table(head: list, rows: list[list], empty: str = "") -> str:
    if not rows:
        return f"<p>{html.escape(empty)}</p>"
    cells = "".join(f"<th>{html.escape(str(c))}</th>" for c in head) if any(head) else ""
    body = "".join("<tr>" + "".join(f"<td>{html.escape(str(c))}</td>" for c in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{body}</table>"


def _nested(values: Mapping[str, Any]) -> str:
    return _table(["", ""], [[name, value] for name, value in values.items()])


def _percent(share: float) -> str:
    return f"{100 * share:.2f} %"


def _numbers(values: Any, digits: int = 3) -> str:
    return ", ".join(f"{v:.{digits}f}" for v in values)


def _median(region: Mapping[str, Any]) -> str:
    return "" if region["time_to_converge_s"] is None else f"{region['time_to_converge_s']['median']:.1f}"
