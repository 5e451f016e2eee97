"""`jaxrmp run SEQUENCE.toml`: policies one after the other in physics, with a video and a report."""

import argparse
from typing import Any

import numpy as np

from .. import learning, sequences, simulation, visualization
from .._errors import ConfigurationError, RolloutError
from ..scenes import Scene, scene
from ._camera import noise_of
from ._output import aligned, clearance_in_words, progress_bar, tell, write_json
from ._sources import demonstrations_of

_OF_SKILLS = ("detour", "learned_rate", "figures", "html", "camera", "camera_distance", "camera_at")
_TRIALS = 1


def run_sequence(arguments: argparse.Namespace) -> None:
    """Run the sequence of `arguments`."""
    if given := [f"--{name.replace('_', '-')}" for name in _OF_SKILLS if getattr(arguments, name)]:
        raise ConfigurationError(f"{', '.join(given)}: for a skill alone, and {arguments.skill} is a sequence.")
    if arguments.video:
        visualization.check_video_name(arguments.video)
        visualization.prepare_headless()
    described = sequences.load_sequence(arguments.skill)
    first = described.first_skill
    place = scene(arguments.scene, T_world_object=None if first is None else np.asarray(first.T_world_object, float))
    with progress_bar(arguments.quiet) as progress:
        progress("preparing", 0.0)
        starts, poses = _starts(arguments, described, place)
        sequence = described.on(place, starts[0][0])
        count = _TRIALS if arguments.trials is None else arguments.trials
        wanted = count if arguments.trial is None else max(count, arguments.trial + 1)
        chance = {"seed": arguments.seed, "displace": arguments.displace}
        trials = simulation.sample_trials(place, starts, poses, wanted, **chance)
        if arguments.trial is not None:
            if arguments.trial < 0:
                raise ConfigurationError(f"--trial {arguments.trial}: they are counted from 0.")
            trials = [trials[arguments.trial]]
        needed = arguments.tracker == "auto" and (place.tracked or arguments.displace)
        result = sequences.run_sequence(
            place,
            sequence,
            trials,
            tracker=noise_of(arguments) if arguments.tracker == "on" or needed else None,
            interface=arguments.interface,
            seed=arguments.seed,
            first=arguments.trial or 0,
            progress=lambda share: progress("running", share),
        )
        report = sequence_report(result, arguments.trial or 0)
        if arguments.json:
            write_json(report, arguments.json)
        if arguments.video:
            progress("filming", 0.0)
            visualization.save_video(result.run, arguments.video)
    print(sequence_table(report))
    failed = [trial["trial"] for trial in report["per_trial"] if not trial["success"]]
    if failed:
        tell(f"{len(failed)} of {len(trials)} trials did not come through: {failed}. Replay one with --trial K.")
    if arguments.strict and failed:
        raise RolloutError(f"--strict: {len(failed)} of {len(trials)} trials did not come through: {failed}.")


def _starts(
    arguments: argparse.Namespace, described: sequences.SequenceFile, place: Scene
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Paths that begin where trials do, and where the object is then: the file's start, or the demonstrations of its
    first skill."""
    if described.start is not None:
        return [described.start[None]], [np.asarray(place.T_world_object, float)]
    skill = described.first_skill
    if skill is None:
        raise ConfigurationError(
            f"{described.path} has no skill whose demonstrations say where the arm starts: add start = [...], rad, of "
            f"its {place.robot.num_joints} joints, at the top."
        )
    skill.check_robot(place.robot)
    demonstrations = demonstrations_of(skill, arguments.demos, place.robot)
    prepared = learning.prepare(skill.configuration, place.robot, demonstrations)
    return list(prepared.joints.q), [np.asarray(T, float) for T in prepared.poses]


def sequence_report(result: sequences.SequenceRun, first: int = 0) -> dict[str, Any]:
    """What --json writes of a sequence: every trial, with every state that it was in."""
    place = result.run.scene
    per_trial = [
        {
            "trial": first + k,
            "success": outcome.success,
            "reason": outcome.reason,
            "time_s": outcome.time_s,
            "min_clearance_m": ended.min_clearance_m,
            "saturated": ended.saturated,
            "velocity_limited": ended.velocity_limited,
            "braked_s": ended.braked_s,
            "scene": ended.left,
            "switches": outcome.jumps,
            "states": [state._asdict() for state in outcome.states],
        }
        for k, (outcome, ended) in enumerate(zip(result.outcomes, result.run.outcomes, strict=True))
    ]
    moved = "driven" if place.gripper is not None else "held by the scene"
    counts = {"trials": len(per_trial), "successes": result.successes}
    return {"scene": place.name, "fingers": moved, **counts, "per_trial": per_trial}


def sequence_table(report: dict[str, Any]) -> str:
    """A line for each state of each trial, and one for the trial."""
    head = ["trial", "state", "end", "seconds", "left_mm", "turn_deg", "V_start", "V_end", "V_rise", "V_jump"]
    rows, notes = [], []
    for trial in report["per_trial"]:
        for state in trial["states"]:
            places = [(1000 * state["left_m"], ".1f"), (state["turn_deg"], ".1f")]
            energies = [(state[f"energy_{key}"], ".2g") for key in ("start", "end", "rise", "jump")]
            cells = [("-" if np.isnan(value) else format(value, form)) for value, form in (*places, *energies)]
            voided = ", ".join(state["uncertified"]) or "nothing"
            told = f"; gripper: {state['gripper']}" if state["gripper"] is not None else ""
            row = [str(trial["trial"]), state["state"], state["end"], f"{state['seconds']:.2f}", *cells]
            rows.append([*row, f"voided by {voided}{told}"])
        verdict = f", the scene says: {trial['scene']}" if trial["scene"] else ""
        ended = f"{trial['reason']} after {trial['time_s']:.1f} s"
        clearance = f"least clearance {clearance_in_words(trial, ' mm')}"
        notes.append(f"trial {trial['trial']}: {ended}, {clearance}{verdict}")
    lines = aligned([*head, "certificate"], rows, of_words=1)
    return "\n".join([*lines, *notes, f"{report['successes']} of {report['trials']} came through"])
