"""`jaxrmp run`: a skill in physics, trial after trial, with pictures, a video and a report."""

import argparse
import contextlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import learning, simulation, visualization
from .._counted import counted
from .._errors import ConfigurationError, RolloutError
from .._pytree import single
from ..perception import DepthTracker
from ..policies import FoundDetour, find_detour, whole_arm_policy
from ..scenes import Scene
from ._camera import camera_report, camera_spheres, check_camera, noise_of, scene_camera
from ._camera_words import seen_in_words
from ._optional import can_draw, require
from ._output import aligned, clearance_in_words, made_by, progress_bar, tell, write_json
from ._report_pages import FIGURES, pictures_in, run_page
from ._run_sequence import run_sequence
from ._sources import demonstrations_of, scene_of

# The options, besides the tracker's, that decide what happens.
_DECISIVE = ("scene", "trial", "trials", "displace", "seed", "limit", "interface", "learned_rate", "detour")
_OF_CAMERA = ("camera", "camera_distance", "camera_at")
_TRIALS = 6
_AHEAD = 10.0  # s that a look ahead is long, at most


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    if arguments.skill.endswith(".toml"):
        return run_sequence(arguments)
    arguments.trials = _TRIALS if arguments.trials is None else arguments.trials
    if arguments.video:
        visualization.check_video_name(arguments.video)
        require("simulation")
    if arguments.figures:
        require("plots")
    check_camera(arguments)
    if arguments.video or arguments.figures or arguments.camera:
        visualization.prepare_headless()
    skill = learning.load_skill(arguments.skill)
    if skill.of_turn:
        raise ConfigurationError(
            f"{arguments.skill} was learned of a turn alone, and scenes judge where the hand arrives: it has no place "
            "to go to. `jaxrmp reproduce` and `jaxrmp evaluate` judge how it is turned."
        )
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
        policy = whole_arm_policy(skill, scene.robot)
        if arguments.detour:
            progress("looking ahead", 0.0)
        ways = _detours(policy, scene, trials, min(_AHEAD, arguments.limit)) if arguments.detour else None
        with _tracker(arguments, skill, scene, prepared) as tracker:
            result = simulation.run_trials(
                scene,
                policy,
                trials,
                aside=ways and ways.aside,
                limit=arguments.limit,
                tracker=tracker,
                interface=arguments.interface,
                learned_rate=arguments.learned_rate,
                seed=arguments.seed,
                first=arguments.trial or 0,
                progress=lambda share: progress("running", share),
            )
        paths = path_errors(result, skill, prepared)
        report = report_dict(result, arguments.trial or 0, paths)
        seen = isinstance(tracker, DepthTracker)
        report["camera"] = camera_report(tracker, scene, prepared) if seen else None
        report["detours"] = ways and _ways(ways)
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
                settings |= {name: getattr(arguments, name) for name in (*_DECISIVE, *_OF_CAMERA, *tracking)}
                figures = pictures_in(drawn) or (_figures(result, prepared, reproduction) if can_draw() else {})
                run_page({**report, "settings": settings}, made, figures, page, arguments.video)
    print(outcome_table(report))
    if diverged := [t["trial"] for t in report["per_trial"] if t["diverged"]]:
        tell(f"{len(diverged)} of {len(trials)} trials diverged: {diverged}. Replay one with --trial K.")
    failed = [t["trial"] for t in report["per_trial"] if not t["success"]]
    if arguments.strict and failed:
        raise RolloutError(
            f"--strict: {len(failed)} of {len(trials)} trials did not succeed: {failed}. Replay one with --trial K."
        )


def _detours(policy: Any, scene: Scene, trials: Sequence[simulation.Trial], duration: float) -> FoundDetour | None:
    """A way round what the policy is told to avoid in each of `trials`, stacked; None, told, where that is nothing."""
    worlds = jax.tree.map(lambda *a: jnp.stack(a), *(single(scene.at(trial).obstacles()) for trial in trials))
    if not scene.at(trials[0]).obstacles().size:
        tell(f"--detour: scene {scene.name!r} tells the policy of no obstacles, so there is nothing to look for.")
        return None
    q, T = (jnp.asarray(part, jnp.float32) for part in ([t.q for t in trials], [t.T_world_object for t in trials]))
    return jax.jit(jax.vmap(lambda q, T, world: find_detour(policy, q, T, world, duration=duration)))(q, T, worlds)


def _ways(found: FoundDetour) -> list[dict[str, Any]]:
    """What was found for each trial, as JSON has it: `strength` 0 is no detour."""
    parts = zip(found.aside.strength, found.aside.lean, found.left, found.clearance, strict=True)
    keys = ("strength_n", "lean_m", "left_m", "clearance_m")
    return [dict(zip(keys, (np.asarray(part).tolist() for part in of), strict=True)) for of in parts]


def _figures(
    result: simulation.Run, prepared: learning.PreparedDemonstrations, reproduction: learning.Reproduction | None
) -> dict[str, tuple[bytes, str]]:
    """Pictures for the page where no others are asked for: those that need no drawing of the scene."""
    figures = {"physics": visualization.physics_figure(result)}
    if reproduction is not None:
        figures["triangles"] = visualization.triangle_figure(prepared, reproduction)
    return {FIGURES[name][0]: (visualization.png(figure), FIGURES[name][1]) for name, figure in figures.items()}


def _tracker(
    arguments: argparse.Namespace, skill: learning.Skill, scene: Scene, prepared: learning.PreparedDemonstrations
) -> contextlib.AbstractContextManager[DepthTracker | simulation.TrackerSettings | None]:
    """What tells the policy where the object is, within which it does."""
    if arguments.camera:
        return scene_camera(arguments, scene, prepared, camera_spheres(skill, scene))
    needed = arguments.tracker == "auto" and (skill.configuration.object or arguments.displace)
    return contextlib.nullcontext(noise_of(arguments) if arguments.tracker == "on" or needed else None)


Paths = Sequence[dict[str, Any] | None]


def path_errors(
    result: simulation.Run, skill: learning.Skill, prepared: learning.PreparedDemonstrations
) -> list[dict[str, Any] | None]:
    """How far the way of each trial is from the `demonstration` (an index) that it starts like: `dtw_cm`, `frechet_cm`,
    as `learning.reproduction_errors` has them, in the object's frame. None where no demonstration starts like it, with
    the object where it is, or where the object is moved on the way."""
    starts = [(q[0], T) for q, T in zip(prepared.joints.q, prepared.poses, strict=True)]
    errors = []
    for trial, trace in zip(result.trials, result.traces, strict=True):
        like = [k for k, (q, T) in enumerate(starts) if (trial.q == q).all() and (trial.T_world_object == T).all()]
        if not like or trial.displacement is not None or len(trace.time) < 2:
            errors.append(None)
            continue
        found = learning.reproduction_errors(prepared.points[like[0]], _path(result.scene, skill, trial, trace.q))
        errors.append({"demonstration": like[0], **{name: found[name] for name in ("dtw_cm", "frechet_cm")}})
    return errors


def _path(scene: Scene, skill: learning.Skill, trial: simulation.Trial, q: np.ndarray) -> np.ndarray:
    """The skill's control points [T, K, 3] along `q` [T, n] in the frame of the trial's object, m."""
    points = learning.control_points(scene.robot, skill.frames, np.asarray(skill.offsets, float), q)
    return learning.in_frame(points, trial.T_world_object)


def report_dict(result: simulation.Run, first: int = 0, paths: Paths | None = None) -> dict[str, Any]:
    """What --json writes: the scene, how many trials succeeded, every trial, with what `path_errors` says of it, and
    the mean of that."""
    paths = paths or [None] * len(result.outcomes)
    compared = [path for path in paths if path is not None]
    mean = {name: sum(path[name] for path in compared) / max(len(compared), 1) for name in ("dtw_cm", "frechet_cm")}
    per_trial = [
        {
            "trial": first + k,
            "success": outcome.success,
            **outcome._asdict(),
            "end": outcome.end.name.lower(),
            "diverged": outcome.diverged,
            "tracking": outcome.tracking and outcome.tracking._asdict(),
            "path": path,
        }
        for k, (outcome, path) in enumerate(zip(result.outcomes, paths, strict=True))
    ]
    counts = {"trials": len(result.outcomes), "successes": result.successes, "trials_compared": len(compared)}
    return {"scene": result.scene.name, **counts, "path": mean if compared else None, "per_trial": per_trial}


def outcome_table(report: dict[str, Any]) -> str:
    """All trials as a table, a line each, and what to know about torques and speeds."""
    head = ["trial", "success", "error_mm", "angle_deg", "clearance_mm", "time_s", "dtw_cm", "frechet_cm", "reason"]
    rows = []
    for trial in report["per_trial"]:
        path = trial["path"]
        rows.append(
            [
                str(trial["trial"]),
                "yes" if trial["success"] else "no",
                f"{1000 * trial['final_error_m']:.1f}",
                "-" if np.isnan(trial["final_angle_deg"]) else f"{trial['final_angle_deg']:.1f}",
                clearance_in_words(trial),
                f"{trial['time_s']:.1f}",
                *(f"{path[name]:.2f}" if path else "-" for name in ("dtw_cm", "frechet_cm")),
                trial["reason"],
            ]
        )
    lines = aligned(head, rows, of_words=1)
    if saturated := [t for t in report["per_trial"] if t["saturated"] > 0]:
        worst = max(saturated, key=lambda t: t["saturated"])
        joints = sorted({joint for t in saturated for joint in t["saturated_joints"]})
        lines.append(
            f"torque limits cut in in {counted(len(saturated), 'trial')}, at most {worst['saturated']:.1%} of the time "
            f"(trial {worst['trial']}): {', '.join(joints)}"
        )
    if ignored := [t["trial"] for t in report["per_trial"] if t["ignored"]]:
        most = max(t["ignored"] for t in report["per_trial"])
        lines.append(
            f"obstacles that are not finite were ignored in {counted(len(ignored), 'trial')}, up to {most}: {ignored}"
        )
    if seen := [t["tracking"] for t in report["per_trial"] if t["tracking"]]:
        lines.append(seen_in_words(seen))
    if mean := report["path"]:
        lines.append(
            f"trials that start as a demonstration did: {report['trials_compared']}; in the mean their ways are "
            f"{mean['dtw_cm']:.2f} cm (DTW) and {mean['frechet_cm']:.2f} cm (Frechet) from it"
        )
    else:
        lines.append("no trial starts as a demonstration did: there is no way to compare (dtw_cm, frechet_cm)")
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
        points.append(_path(result.scene, skill, trial, trace.q[rows]))
        errors.append(learning.reproduction_errors(demonstrated, points[-1][: len(trace.time)]))
    time, q, qd = (np.stack(column) for column in zip(*states, strict=True))
    rollouts = simulation.Rollout(time, q, qd, np.zeros(time.shape), np.zeros((*time.shape, 0)), ())
    return learning.Reproduction(rollouts, np.stack(points), tuple(errors))
