"""The report of an evaluation as one page."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..reports import _page
from ..reports._page import heading, numbers, paragraph, percent, records, table
from ._report import KINDS


def write_page(
    report: Mapping[str, Any], figures: Mapping[str, tuple[bytes, str]], path: str | os.PathLike, *, title: str
) -> Path:
    """Write the page `title` to `path`; it appears whole or not at all.

    **Arguments**: `report`, as `report` gives it, with `settings` and `made_by` if there are; `figures`, for each
    heading a PNG picture and what it shows.
    """
    parts = [
        _summary(report),
        _page.pictures(figures),
        heading("By start region"),
        records(
            report["regions"],
            {
                "region": lambda r: r["region"],
                "starts": lambda r: r["starts"],
                **{  # of ends that there were; that there were none of the others stands above
                    name.replace("_", " "): lambda r, name=name: percent(r[name]) for name in _ends(report)
                },
                "median time, s": _median,
            },
        ),
        heading("Rest points away from the goal"),
        table(
            ["share", "distance of the worst control point, m", "joints", "starts"],
            [
                [percent(p["share"]), f"{p['error_m']:.3f}", numbers(p["joints"]), numbers(p["starts"][:5], 0)]
                for p in report["spurious_rest_points"]
            ],
            "None was found.",
        ),
        heading("Stops at joint limits"),
        table(
            ["joint", "share", "largest distance to the limit, rad", "median distance to the goal, m"],
            [
                [p["joint"], percent(p["share"]), f"{p['max_margin_rad']:.3f}", f"{p['median_error_m']:.3f}"]
                for p in report["limit_stops"]
            ],
            "None.",
        ),
        _stability(report["stability"]),
        heading(f"Failing starts ({report['failing_starts']})"),
        paragraph("Replay one by its index: `jaxrmp evaluate SKILL ... --replay INDEX`, all else as here."),
        table(
            ["start", "end", "error, m", "time, s"],
            [[f["start"], f["end"], f"{f['error_m']:.3f}", f"{f['seconds']:.1f}"] for f in report["failing"][:200]],
            "None.",
        ),
        _page.settings(report, ("settings", "made_by")),
    ]
    return _page.write_page(path, title, parts)


def _summary(report: Mapping[str, Any]) -> str:
    rows = [["starts", report["starts"]]]
    rows += [[name.replace("_", " "), percent(report[name])] for name in KINDS.values()]
    times, touched, least = (report[of] for of in ("time_to_converge_s", "starts_that_touched", "min_clearance_m"))
    if times:
        rows.append(["time to converge: median, 95 %, longest, s", numbers(times.values(), 1)])
    rows += [
        ["non-finite", report["non_finite"]],
        ["largest energy increase, of V's range", f"{report['max_energy_increase']:.1e}"],
        ["smallest clearance, m", f"{least:.3f}" if np.isfinite(least) else "not watched"],
        ["starts that touched something", "not watched" if touched is None else touched],
        ["smallest distance to a joint limit, rad", f"{report['min_limit_margin_rad']:.4f}"],
        ["starts that crossed a limit", report["starts_that_crossed_a_limit"]],
        ["fastest joint, rad/s", f"{report['max_joint_speed_rad_s']:.2f}"],
    ]
    return table(["", ""], rows)


def _stability(found: Mapping[str, Any]) -> str:
    certificate = found["certificate"]
    stationary = [
        [s["name"], p["kind"], f"{p['distance_m']:.4f}", numbers(p["position"]), numbers(p["eigenvalues"], 2)]
        for s in found["subtasks"]
        for p in s.get("stationary_points", ())
    ]
    uncertified = ", ".join(certificate["uncertified_leaves"]) or "none"
    return "".join(
        [
            heading("Stability"),
            paragraph(
                f"Leaves without a certificate: {uncertified}. Along all rollouts, dV/dt differs from minus the "
                f"dissipation by at most {certificate['max_residual']:.1e} (1 + |V|) per second, and is at most "
                f"{certificate['max_growth_rate']:.1e} (1 + |V|) per second; not a number from "
                f"{certificate['starts_not_a_number']} starts."
            ),
            records(
                found["subtasks"],
                {
                    "subtask": lambda s: s["name"],
                    "metric's eigenvalues over the region": lambda s: (
                        f"{s['metric']['least_eigenvalue']:.3g} to {s['metric']['largest_eigenvalue']:.3g}"
                    ),
                    "positive definite": lambda s: percent(s["metric"]["positive_definite_share"]),
                    "slope at the goal": lambda s: f"{s['goal']['slope']:.1e}",
                    "Hessian's eigenvalues at the goal, 1/m": lambda s: numbers(s["goal"]["hessian_eigenvalues"], 1),
                    "stationary points": lambda s: len(s.get("stationary_points", ())) or "not looked for",
                },
            ),
            table(
                ["subtask", "kind", "distance from the goal, m", "position, m", "Hessian's eigenvalues, 1/m"],
                stationary,
                "Stationary points were not looked for.",
            ),
        ]
    )


def _ends(report: Mapping[str, Any]) -> list[str]:
    """The kinds of ends that some rollout had."""
    return [name for name in KINDS.values() if report[name]]


def _median(region: Mapping[str, Any]) -> str:
    return "" if region["time_to_converge_s"] is None else f"{region['time_to_converge_s']['median']:.1f}"
