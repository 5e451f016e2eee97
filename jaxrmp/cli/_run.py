"""`jaxrmp run`: a skill in physics, trial after trial, with pictures, a video and a report."""

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from .. import learning, simulation, visualization
from .._errors import ConfigurationError, RolloutError
from ..policies import whole_arm_policy
from ._output import made_by, progress_bar, tell, write_json
from ._report_pages import FIGURES, pictures_in, run_page
from ._sources import demonstrations_of, scene_of

# The options, besides the tracker's, that decide what happens.
_DECISIVE = ("scene", "trial", "trials", "displace", "seed", "limit", "interface", "learned_rate")


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    if arguments.video:
        visualization.check_video_name(arguments.video)
    if arguments.video or arguments.figures:
        visualization.prepare_headless()
    skill = learning.load_skill(arguments.skill)
    scene = scene_of(arguments.scene, skill)
    demonstrations = demonstrations_of(skill, arguments.demos, scene.robot)
    with progress_bar(arguments.quiet) as progress:
        progress("preparing", 0.0)
        prepared = learning.prepare(skill.configuration, scene.robot, demonstrations)
        chance = {"seed": arguments.seed, "displace": arguments.displace}
        trials = simulation.sample_trials(scene, prepared.joints.q, prepared.poses, arguments.trials, **chance)
        if arguments.trial is not None:
            if not 0 <= arguments.trial < len(trials):
                raise ConfigurationError(f"--trial {arguments.trial}: there are trials 0 to {len(trials) - 1}.")
            trials = [trials[arguments.trial]]
        if scene.hand:
            scene = replace(scene, T_object_hand=learning.demonstrated_end(prepared, scene.robot, scene.hand))
        result = simulation.run_trials(
            scene,
            whole_arm_policy(skill, scene.robot),
            trials,
            limit=arguments.limit,
            tracker=_tracker(arguments, skill),
            interface=arguments.interface,
            learned_rate=arguments.learned_rate,
            seed=arguments.seed,
            first=arguments.trial or 0,
            progress=lambda share: progress("running", share),
        )
        report = report_dict(result, arguments.trial or 0)
        if arguments.json:
            write_json(report, arguments.json)
        if arguments.video:
            progress("filming", 0.0)
            visualization.save_video(result, arguments.video)
        page = arguments.html or (arguments.json and arguments.json.with_suffix(".html"))
        if page or arguments.figures:
            progress("drawing", 0.5)
            made = made_by("run", skill.configuration, demonstrations.source)
            reproduction = _as_reproduction(skill, prepared, result)
            drawn = []
            if arguments.figures:
                write_json(made, arguments.figures / "made_by.json")
                drawn = visualization.save_physics_figures(result, prepared, reproduction, arguments.figures)
            if page:
                tracking = [name for name in vars(arguments) if name.startswith("tracker")]
                settings = {"skill": str(arguments.skill), "learned_from": skill.source}
                settings |= {name: getattr(arguments, name) for name in (*_DECISIVE, *tracking)}
                figures = pictures_in(drawn) or _figures(result, prepared, reproduction)
                run_page({**report, "settings": settings}, made, figures, page)
    print(outcome_table(report))
    if diverged := [t["trial"] for t in report["per_trial"] if t["diverged"]]:
        tell(f"{len(diverged)} of {len(trials)} trials diverged: {diverged}. Replay one with --trial K.")
    failed = [t["trial"] for t in report["per_trial"] if not t["success"]]
    if arguments.strict and failed:
        raise RolloutError(
            f"--strict: {len(failed)} of {len(trials)} trials did not succeed: {failed}. Replay one with --trial K."
        )


def _figures(
    result: simulation.Run, prepared: learning.PreparedDemonstrations, reproduction: learning.Reproduction | None
) -> dict[str, tuple[bytes, str]]:
    """Pictures for the page where no others are asked for: those that need no drawing of the scene."""
    figures = {"physics": visualization.physics_figure(result)}
    if reproduction is not None:
        figures["triangles"] = visualization.triangle_figure(prepared, reproduction)
    return {FIGURES[name][0]: (visualization.png(figure), FIGURES[name][1]) for name, figure in figures.items()}


def _tracker(arguments: argparse.Namespace, skill: learning.Skill) -> simulation.TrackerSettings | None:
    needed = arguments.tracker == "auto" and (skill.configuration.object or arguments.displace)
    if arguments.tracker != "on" and not needed:
        return None
    given = {name: getattr(arguments, f"tracker_{name}") for name in ("delay", "dropouts", "bias", "silent_after")}
    return simulation.TrackerSettings(**given)


def report_dict(result: simulation.Run, first: int = 0) -> dict[str, Any]:
    """What --json writes: the scene, how many trials succeeded, and every trial."""
    per_trial = [
        {
            "trial": first + k,
            "success": outcome.success,
            **outcome._asdict(),
            "end": outcome.end.name.lower(),
            "diverged": outcome.diverged,
        }
        for k, outcome in enumerate(result.outcomes)
    ]
    counts = {"trials": len(result.outcomes), "successes": result.successes}
    return {"scene": result.scene.name, **counts, "per_trial": per_trial}


def outcome_table(report: dict[str, Any]) -> str:
    """All trials as a table, a line each, and what to know about torques and speeds."""
    lines = ["trial  success  error_mm  angle_deg  clearance_mm  time_s  reason"]
    for trial in report["per_trial"]:
        angle = "-" if np.isnan(trial["final_angle_deg"]) else f"{trial['final_angle_deg']:.1f}"
        lines.append(
            f"{trial['trial']:>5}{'yes' if trial['success'] else 'no':>9}{1000 * trial['final_error_m']:>10.1f}"
            f"{angle:>11}{1000 * trial['min_clearance_m']:>14.1f}{trial['time_s']:>8.1f}  {trial['reason']}"
        )
    if saturated := [t for t in report["per_trial"] if t["saturated"] > 0]:
        worst = max(saturated, key=lambda t: t["saturated"])
        joints = sorted({joint for t in saturated for joint in t["saturated_joints"]})
        lines.append(
            f"torque limits cut in in {len(saturated)} trials, at most {worst['saturated']:.1%} of the time (trial "
            f"{worst['trial']}): {', '.join(joints)}"
        )
    if ignored := [t["trial"] for t in report["per_trial"] if t["ignored"]]:
        most = max(t["ignored"] for t in report["per_trial"])
        lines.append(f"obstacles that are not finite were ignored in {len(ignored)} trials, up to {most}: {ignored}")
    lines.append(f"{report['successes']} of {report['trials']} trials succeeded in scene {report['scene']}")
    return "\n".join(lines)


def _as_reproduction(
    skill: learning.Skill, prepared: learning.PreparedDemonstrations, result: simulation.Run
) -> learning.Reproduction | None:
    """The first trials as reproductions of the demonstrations that they start from, for the figures."""
    count = min(len(prepared.points), len(result.trials))
    if count < len(prepared.points):
        return None
    longest = max(len(trace.time) for trace in result.traces[:count])
    points, errors, states = [], [], []
    for trace, trial, demonstrated in zip(result.traces, result.trials, prepared.points, strict=False):
        rows = np.minimum(np.arange(longest), len(trace.time) - 1)  # stays where it ended
        states.append((trace.time[rows], trace.q[rows], trace.qd[rows]))
        path = learning.control_points(
            result.scene.robot, skill.frames, np.asarray(skill.offsets, float), trace.q[rows]
        )
        points.append(learning.in_frame(path, trial.T_world_object))
        errors.append(learning.reproduction_errors(demonstrated, points[-1][: len(trace.time)]))
    time, q, qd = (np.stack(column) for column in zip(*states, strict=True))
    rollouts = simulation.Rollout(time, q, qd, np.zeros(time.shape), np.zeros((*time.shape, 0)), ())
    return learning.Reproduction(rollouts, np.stack(points), tuple(errors))
