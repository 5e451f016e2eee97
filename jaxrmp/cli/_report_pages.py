"""What `learn` and `run` have to tell, as one page each."""

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from ..reports import _page
from ..reports._page import heading, numbers, paragraph, percent, records
from ._camera_words import camera_in_words
from ._output import NOT_VALIDATED, SOME_MEASURE, fold_failed, folds_passed, measured

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
    parts = [
        paragraph(
            f"Learned from {report['source']} in {sum(seconds.values()):.1f} s by the method {report['method']!r}: "
            f"{report['why']}. Frame: {report['frame']}."
        ),
        heading("How well it reproduces"),
        paragraph(f"Measured on {reproduction['measured_on']}; every rollout starts where its demonstration did."),
        records(
            [*reproduction["per_demo"], {"demo": "mean", "rests_away_from": (), **reproduction["mean"]}],
            {
                "demonstration": lambda e: e["demo"],
                "DTW, cm": lambda e: _hundredths(e["dtw_cm"]),
                "Fréchet, cm": lambda e: _hundredths(e["frechet_cm"]),
                "goal, cm": lambda e: _hundredths(e["goal_cm"]),
                **{
                    SOME_MEASURE[name]: lambda e, name=name: _hundredths(e.get(name))
                    for name in measured(reproduction["per_demo"])
                },
                "energy increase": lambda e: f"{e['energy_increase']:.1e}",
                "limit margin, rad": lambda e: f"{e['limit_margin_rad']:.3f}",
                "rests away from": lambda e: ", ".join(e["rests_away_from"]),
            },
        ),
        *_validation(report["validation"]),
        *([_flow(report["flow"])] if report["flow"] else _subtasks(report["subtasks"])),
        _page.pictures(figures),
        heading("Demonstrations as they were read"),
        paragraph(f"How they agree: {report['families']['text']}"),
        paragraph(f"The robot and itself: {report['self_clearance']['text']}."),
        records(
            enumerate(report["demonstrations"]),
            {
                "demonstration": lambda d: d[0],
                "samples": lambda d: d[1]["samples_read"],
                "seconds": lambda d: f"{d[1]['duration']:.1f}",
                "repeats merged": lambda d: d[1]["repeats_merged"],
                "gaps": lambda d: d[1]["gaps"],
                "largest gap, s": lambda d: f"{d[1]['largest_gap']:.3f}",
                "pauses dropped, s": lambda d: f"{d[1]['pause_seconds_dropped']:.2f}",
                "from, s": lambda d: ", ".join(f"{at:.1f}" for at, _ in d[1]["pauses"]),
            },
        ),
        _page.settings(made_by, ("configuration", "versions")),
    ]
    return _page.write_page(path, f"{report['skill']}: what was learned", parts)


def _hundredths(value: float | None) -> str:
    """A number to a hundredth; nothing where there is none."""
    return "" if value is None else f"{value:.2f}"


def _validation(validation: Mapping[str, Any] | None) -> list[str]:
    title = heading("How well it does what it was not shown")
    if validation is None:
        return [title, paragraph(f"{NOT_VALIDATED}.".replace("--validate", "`jaxrmp learn --validate`").capitalize())]
    some = measured([fold["held_out"] for fold in validation["folds"]])
    mean = {"left_out": "mean", "method": "", "failed": None, **validation}

    def error(kind: str, name: str) -> Callable[[Mapping[str, Any]], str]:
        return lambda fold: _hundredths((fold[kind] or {}).get(name))

    return [
        title,
        paragraph(
            "Each demonstration was left out in turn: learned without it by the same configuration and seed, it was "
            f"reproduced from its own start. {folds_passed(validation).capitalize()}."
        ),
        records(
            [*validation["folds"], mean],
            {
                "left out": lambda f: f["left_out"],
                "method": lambda f: f["method"],
                "held out: DTW, cm": error("held_out", "dtw_cm"),
                "Fréchet, cm": error("held_out", "frechet_cm"),
                "goal, cm": error("held_out", "goal_cm"),
                **{f"held out: {SOME_MEASURE[name]}": error("held_out", name) for name in some},
                "training: DTW, cm": error("training", "dtw_cm"),
                "training: Fréchet, cm": error("training", "frechet_cm"),
                **{f"training: {SOME_MEASURE[n]}": error("training", n) for n in some if n == "time_aligned_cm"},
            },
        ),
        *(paragraph(fold_failed(fold)) for fold in validation["folds"] if fold["failed"]),
    ]


def _flow(flow: Mapping[str, Any]) -> str:
    return heading("Flow") + paragraph(
        f"One flow moves the whole hand. Its loss fell from {flow['first_loss']:.3g} to {flow['last_loss']:.3g}; it "
        f"stretches space by {flow['least_stretch']:.2g} to {flow['largest_stretch']:.2g} on the demonstrations, and "
        "its one place of rest is the goal."
    )


def _subtasks(subtasks: Iterable[Mapping[str, Any]]) -> list[str]:
    return [
        heading("Subtasks"),
        records(
            subtasks,
            {
                "subtask": lambda s: s["name"],
                "nominal demonstration": lambda s: s["nominal_demonstration"],
                "kernel width, m": lambda s: s["potential"]["width"],
                "convex program": lambda s: s["potential"]["status"],
                "mean cosine": lambda s: f"{s['potential']['alignment']:.3f}",
                "beyond 90 degrees": lambda s: percent(s["potential"]["beyond_90"]),
                "random starts that reach the goal": lambda s: _reached(s["potential"]["basin"]),
                "Hessian's eigenvalues at the goal, 1/m": lambda s: numbers(
                    s["potential"]["goal_hessian_eigenvalues"], 1
                ),
                "loss, first and last": lambda s: f"{s['metric']['first_loss']:.3g}, {s['metric']['last_loss']:.3g}",
            },
        ),
        paragraph(
            "The mean cosine is that between the potential's slope and the directions of all demonstrations. Samples "
            "beyond 90 degrees run against the potential, and no metric can turn it that far."
        ),
    ]


def run_page(
    report: Mapping[str, Any],
    made_by: Mapping[str, Any],
    figures: Mapping[str, tuple[bytes, str]],
    path: Path,
    video: Path | None = None,
) -> Path:
    """Write how trials in physics went, with the pictures and the `video`, for a person; `report` is what `run --json`
    writes."""
    parts = [
        paragraph(
            f"{report['successes']} of {report['trials']} trials succeeded in scene {report['scene']}, in MuJoCo at "
            "1 kHz with contacts and torque limits. Replay one with `--trial K`, all else as here."
        ),
        paragraph(_paths(report)),
        *([heading("The camera"), paragraph(camera_in_words(report))] if report["camera"] else []),
        records(
            report["per_trial"],
            {
                "trial": lambda t: t["trial"],
                "success": lambda t: "yes" if t["success"] else "no",
                "how it ended": lambda t: t["reason"],
                "left to the goal, mm": lambda t: f"{1000 * t['final_error_m']:.1f}",
                "angle, degrees": lambda t: "" if math.isnan(t["final_angle_deg"]) else f"{t['final_angle_deg']:.1f}",
                "least clearance, mm": lambda t: (
                    f"{1000 * t['min_clearance_m']:.1f}" if math.isfinite(t["min_clearance_m"]) else "not checked"
                ),
                "time, s": lambda t: f"{t['time_s']:.1f}",
                "demonstration": lambda t: t["path"]["demonstration"] if t["path"] else "",
                "DTW, cm": lambda t: f"{t['path']['dtw_cm']:.2f}" if t["path"] else "",
                "Fréchet, cm": lambda t: f"{t['path']['frechet_cm']:.2f}" if t["path"] else "",
                "steps at a torque limit": lambda t: percent(t["saturated"]),
                "steps at a velocity limit": lambda t: percent(t["velocity_limited"]),
                "braked without a pose, s": lambda t: f"{t['braked_s']:.2f}",
                "images without the object": lambda t: f"{t['tracking']['lost']}" if t["tracking"] else "",
                "object seen wrong by, mm": lambda t: (
                    f"{1000 * t['tracking']['position_m']:.1f}" if t["tracking"] else ""
                ),
            },
        ),
        *([_page.video(video, "The first trials, one after the other, in real time.")] if video else []),
        _page.pictures(figures),
        _page.settings(report, ("settings",)),
        _page.settings(made_by, ("configuration", "versions")),
    ]
    return _page.write_page(path, f"{made_by['configuration']['name']} in scene {report['scene']}", parts)


def _paths(report: Mapping[str, Any]) -> str:
    mean = report["path"]
    if mean is None:
        return "No trial starts as a demonstration did, so there is no path to compare."
    return (
        f"Trials that start as a demonstration did: {report['trials_compared']}. In the mean their paths are "
        f"{mean['dtw_cm']:.2f} cm (DTW) and {mean['frechet_cm']:.2f} cm (Fréchet) from it, in the object's frame."
    )


def _reached(basin: Mapping[str, Any] | None) -> str:
    return percent(basin["share_reached"]) if basin else "not needed"
