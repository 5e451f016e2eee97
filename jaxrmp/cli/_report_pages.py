"""What `learn` and `run` have to tell, as one page each."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..reports import _page
from ..reports._page import heading, numbers, paragraph, percent, table

FIGURES = {
    "vector_field": (
        "The learned field",
        "In the plane in which the demonstrations vary most: the potential's slope, and the same warped by the metric.",
    ),
    "kernel_width": (
        "Choice of the kernel width",
        "Agreement with all demonstrations, and the basin, by kernel width.",
    ),
    "loss": ("Training", "The loss of every subtask's metric."),
    "triangles": ("Demonstrated and reproduced", "The control points, joined up at instants even in arc length."),
    "energy": ("Energy", "V along every reproduction; it must not rise."),
    "physics": ("Physics over time", "The furniture's joint, the fastest joint and the largest torque of every trial."),
    "snapshots": ("Snapshots", "One trial at six instants."),
}


def pictures_in(paths: Iterable[Path]) -> dict[str, tuple[bytes, str]]:
    """Figures that were written as files, by heading, each with what it shows."""
    found = {}
    for path in paths:
        title, caption = next(entry for name, entry in FIGURES.items() if path.stem.startswith(name))
        detail = path.stem.removeprefix("vector_field").lstrip("_0123456789").replace("_", " ")
        found[f"{title}: {detail}" if path.stem.startswith("vector_field") else title] = (path.read_bytes(), caption)
    return found


def learning_page(
    report: Mapping[str, Any], made_by: Mapping[str, Any], figures: Mapping[str, tuple[bytes, str]], path: Path
) -> Path:
    """Write what `learning_report.json` and `made_by.json` say, with the pictures, for a person."""
    reproduction, seconds = report["reproduction"], report["seconds"]
    total = sum(seconds[step] for step in ("preprocessing", "potentials", "metrics"))
    subtasks = [
        [
            s["name"],
            s["nominal_demonstration"],
            s["potential"]["width"],
            s["potential"]["status"],
            f"{s['potential']['alignment']:.3f}",
            percent(s["potential"]["beyond_90"]),
            percent(s["potential"]["basin"]["share_reached"]) if s["potential"]["basin"] else "not needed",
            numbers(s["potential"]["goal_hessian_eigenvalues"], 1),
            f"{s['metric']['first_loss']:.3g}, {s['metric']['last_loss']:.3g}",
        ]
        for s in report["subtasks"]
    ]
    parts = [
        paragraph(
            f"Learned from {report['source']} in {total:.1f} s, of which {seconds['metric_loop']:.1f} s went into the "
            f"training loop. Frame: {report['frame']}."
        ),
        heading("How well it reproduces"),
        paragraph(f"Measured on {reproduction['measured_on']}; every rollout starts where its demonstration did."),
        _errors(reproduction),
        heading("Subtasks"),
        table(
            [
                "subtask",
                "nominal demonstration",
                "kernel width, m",
                "convex program",
                "mean cosine",
                "beyond 90 degrees",
                "random starts that reach the goal",
                "Hessian's eigenvalues at the goal, 1/m",
                "loss, first and last",
            ],
            subtasks,
        ),
        paragraph(
            "The mean cosine is that between the potential's slope and the directions of all demonstrations. Samples "
            "beyond 90 degrees run against the potential, and no metric can turn it that far."
        ),
        _page.pictures(figures),
        heading("Demonstrations as they were read"),
        table(
            ["demonstration", "samples", "seconds", "repeats merged", "gaps", "largest gap, s", "pauses dropped, s"],
            [
                [
                    i,
                    d["samples_read"],
                    f"{d['duration']:.1f}",
                    d["repeats_merged"],
                    d["gaps"],
                    f"{d['largest_gap']:.3f}",
                    f"{d['pause_seconds_dropped']:.2f}",
                ]
                for i, d in enumerate(report["demonstrations"])
            ],
        ),
        _page.settings(made_by, ("configuration", "versions")),
    ]
    return _page.write_page(path, f"{report['skill']}: what was learned", parts)


def run_page(
    report: Mapping[str, Any], made_by: Mapping[str, Any], figures: Mapping[str, tuple[bytes, str]], path: Path
) -> Path:
    """Write how trials in physics went, with the pictures, for a person; `report` is what `run --json` writes."""
    trials = report["per_trial"]
    rows = [
        [
            t["trial"],
            "yes" if t["success"] else "no",
            t["reason"],
            f"{1000 * t['final_error_m']:.1f}",
            "" if t["final_angle_deg"] != t["final_angle_deg"] else f"{t['final_angle_deg']:.1f}",
            f"{1000 * t['min_clearance_m']:.1f}",
            f"{t['time_s']:.1f}",
            percent(t["saturated"]),
            percent(t["velocity_limited"]),
            f"{t['braked_s']:.2f}",
        ]
        for t in trials
    ]
    parts = [
        paragraph(
            f"{report['successes']} of {report['trials']} trials succeeded in scene {report['scene']}, in MuJoCo at "
            "1 kHz with contacts and torque limits. Replay one with `--trial K`, all else as here."
        ),
        table(
            [
                "trial",
                "success",
                "how it ended",
                "left to the goal, mm",
                "angle, degrees",
                "least clearance, mm",
                "time, s",
                "steps at a torque limit",
                "steps at a velocity limit",
                "braked without a pose, s",
            ],
            rows,
        ),
        _page.pictures(figures),
        _page.settings(report, ("settings",)),
        _page.settings(made_by, ("configuration", "versions")),
    ]
    return _page.write_page(path, f"{made_by['configuration']['name']} in scene {report['scene']}", parts)


def _errors(reproduction: Mapping[str, Any]) -> str:
    rows = [(e["demo"], e, ", ".join(e["rests_away_from"])) for e in reproduction["per_demo"]]
    return table(
        [
            "demonstration",
            "DTW, cm",
            "Fréchet, cm",
            "goal, cm",
            "energy increase",
            "limit margin, rad",
            "rests away from",
        ],
        [
            [
                name,
                *(f"{e[key]:.2f}" for key in ("dtw_cm", "frechet_cm", "goal_cm")),
                f"{e['energy_increase']:.1e}",
                f"{e['limit_margin_rad']:.3f}",
                away,
            ]
            for name, e, away in [*rows, ("mean", reproduction["mean"], "")]
        ],
    )
