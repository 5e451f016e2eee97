"""`jaxrmp learn`: from a configuration and demonstrations to a skill, a report and pictures."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from .._counted import counted
from .._errors import ConfigurationError, DemonstrationError
from ..kinematics import Robot
from ..learning import (
    Configuration,
    DemonstrationSet,
    Learning,
    PoseSettings,
    RecordingSettings,
    families,
    learn,
    learning_report,
    leave_one_out,
    load_configuration,
    prepare,
    reproduce,
    save_demonstrations,
    save_skill,
    validate,
)
from ..visualization import save_learning_figures, save_reproduction_figures
from ._optional import can_draw, require
from ._output import error_table, made_by, progress_bar, tell, validation_table, write_json
from ._overrides import parse_overrides
from ._report_pages import learning_page, pictures_in
from ._reproduce import result_dict
from ._sources import RECORDED, default_demonstrations, find_demonstrations


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    require("learning")
    said = {f"recording.{key}": value for key in RECORDED if (value := getattr(arguments, key))}
    configuration = load_configuration(arguments.config, parse_overrides(rest) | said)
    robot = configuration.load_robot()
    demonstrations = find_demonstrations(
        arguments.demos or default_demonstrations(configuration.name), configuration, robot
    )
    out = arguments.out or Path("out") / configuration.name
    if out.exists() and not out.is_dir():
        raise ConfigurationError(f"--out {str(out)!r} is a file: give a folder.")
    if not arguments.groups:
        report = _learn(configuration, robot, demonstrations, out, arguments)
    else:
        found = families(prepare(configuration, robot, demonstrations).points)
        if not (found.certain and found.groups):
            raise DemonstrationError(f"{demonstrations.source}: no groups to learn from. {found}")
        tell("; ".join(map(str, found.parting)) or str(found))
        if found.odd:
            tell(f"left out, like no other: {', '.join(map(str, found.odd))}")
        learned = []
        for k, group in enumerate(found.groups):
            members = replace(demonstrations, demonstrations=tuple(demonstrations[n] for n in group))
            folder = save_demonstrations(members, out / f"group_{k}" / "demonstrations", overwrite=True)
            print(f"group_{k}: demonstrations {', '.join(map(str, group))}, in {folder} as 0 to {len(group) - 1}")
            own = replace(configuration, recording=RecordingSettings(), poses=PoseSettings())  # copies leave none open
            report = _learn(own, robot, find_demonstrations(str(folder)), folder.parent, arguments)
            learned.append({"demonstrations_of_all": list(group), **report})
        report = {"groups": learned, "odd": list(found.odd)}
    if arguments.json:
        write_json(report, arguments.json)


def _learn(
    configuration: Configuration,
    robot: Robot,
    demonstrations: DemonstrationSet,
    out: Path,
    arguments: argparse.Namespace,
) -> dict[str, Any]:
    """Learn one skill, write all of it to the folder `out`, print what it is like, and return its report."""
    if arguments.validate:
        leave_one_out(demonstrations)  # says at once if they are too few
    out.mkdir(parents=True, exist_ok=True)
    with progress_bar(arguments.quiet) as progress:
        learning = learn(configuration, robot, demonstrations, progress)
        made = made_by("learn", configuration, demonstrations.source)
        write_json(made, out / "made_by.json")
        skill_file = save_skill(learning.skill, out / f"{configuration.name}.skill.npz")
        progress("reproducing", 0.0)
        reproduction = learning.reproduction or reproduce(learning.skill, robot, learning.prepared)
        result = result_dict(reproduction, learning.skill, demonstrations.source)
        validation = validate(configuration, robot, demonstrations, progress) if arguments.validate else None
        report = {**learning_report(learning, validation), "reproduction": result}
        write_json(report, out / "learning_report.json")
        progress("drawing", 0.5)
        drawn = []
        if can_draw():
            drawn = save_learning_figures(learning, out / "figures")
            drawn += save_reproduction_figures(learning.prepared, reproduction, out / "figures")
        learning_page(report, made, pictures_in(drawn), out / "report.html")
    if learning.skill.configuration.object != configuration.object:
        tell(
            f"the demonstrations track no object, so the skill lives in the frame of {configuration.base!r} "
            f"and knows no {configuration.object!r}. In CSV files, are its columns there?"
        )
    print(_summary(learning))
    print(error_table(result))
    print(validation_table(report["validation"]))
    print(f"skill written to {skill_file}; the report to read is {out / 'report.html'}")
    return {"skill_file": str(skill_file), **report}


def _summary(learning: Learning) -> str:
    """What a person should know before trusting the skill, a line each."""
    skill, seconds = learning.skill, learning.seconds
    lines = [
        f"learned {skill.configuration.name} from {skill.source}",
        f"frame: {learning.prepared.frame}",
    ]
    for i, report in enumerate(learning.prepared.joints.reports):
        found = [
            f"{report.repeats_merged} repeated stamps" if report.repeats_merged else "",
            f"{counted(report.gaps, 'gap')}, the largest {report.largest_gap:.2f} s" if report.gaps else "",
            f"{report.pause_seconds_dropped:.1f} s of pauses dropped ({report.paused})"
            if report.pauses_dropped
            else "",
        ]
        if any(found):
            lines.append(f"demonstration {i}: {', '.join(filter(None, found))}")
    lines.append(f"the robot and itself: {learning.clearance}")
    lines.append(f"by the method {skill.method!r}: {learning.why}")
    if learning.flow is not None:
        fit = learning.flow.fit
        lines.append(f"flow: stretches space by {fit.stretch[0]:.2g} to {fit.stretch[1]:.2g} on the demonstrations")
    widths = skill.configuration.potential.widths
    for name, choice in zip(skill.subtasks, learning.paper.potentials if learning.paper else (), strict=False):
        trial, basin = choice.trial, choice.trial.basin
        at_edge = len(widths) > 1 and trial.width in (min(widths), max(widths))
        end, beyond = ("least", "smaller ones") if trial.width == min(widths) else ("largest", "larger ones")
        lines.append(
            f"{name}: convex program {choice.fit.status}, kernel width {trial.width} m"
            f"{f', the {end} of potential.widths: try {beyond} too' if at_edge else ''}, basin "
            f"{basin.share_reached:.1%} of {basin.starts} starts, beyond 90 degrees {trial.beyond_90:.1%}"  # type: ignore[union-attr]
        )
    lines.append(f"time: {sum(seconds.values()):.1f} s, {', '.join(f'{step} {s:.1f}' for step, s in seconds.items())}")
    return "\n".join(lines)
