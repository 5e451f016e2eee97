"""`jaxrmp learn`: from a configuration and demonstrations to a skill, a report and pictures."""

import argparse
from pathlib import Path

from .._errors import ConfigurationError
from ..learning import Learning, learn, learning_report, load_configuration, reproduce, save_skill
from ..visualization import save_learning_figures, save_reproduction_figures
from ._output import error_table, made_by, progress_bar, tell, write_json
from ._overrides import parse_overrides
from ._report_pages import learning_page, pictures_in
from ._reproduce import result_dict
from ._sources import RECORDED, default_demonstrations, find_demonstrations


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    said = {f"recording.{key}": value for key in RECORDED if (value := getattr(arguments, key))}
    configuration = load_configuration(arguments.config, parse_overrides(rest) | said)
    robot = configuration.load_robot()
    demonstrations = find_demonstrations(
        arguments.demos or default_demonstrations(configuration.name), configuration, robot
    )
    out = arguments.out or Path("out") / configuration.name
    if out.exists() and not out.is_dir():
        raise ConfigurationError(f"--out {str(out)!r} is a file: give a folder.")
    out.mkdir(parents=True, exist_ok=True)
    with progress_bar(arguments.quiet) as progress:
        learning = learn(configuration, robot, demonstrations, progress)
        made = made_by("learn", configuration, demonstrations.source)
        write_json(made, out / "made_by.json")
        skill_file = save_skill(learning.skill, out / f"{configuration.name}.skill.npz")
        progress("reproducing", 0.0)
        reproduction = reproduce(learning.skill, robot, learning.prepared)
        result = result_dict(reproduction, learning.skill, demonstrations.source)
        report = {**learning_report(learning), "reproduction": result}
        write_json(report, out / "learning_report.json")
        if arguments.json:
            write_json({"skill_file": str(skill_file), **report}, arguments.json)
        progress("drawing", 0.5)
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
    print(f"skill written to {skill_file}; the report to read is {out / 'report.html'}")


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
            f"{report.gaps} gaps, the largest {report.largest_gap:.2f} s" if report.gaps else "",
            f"{report.pause_seconds_dropped:.1f} s of pauses dropped" if report.pauses_dropped else "",
        ]
        if any(found):
            lines.append(f"demonstration {i}: {', '.join(filter(None, found))}")
    widths = skill.configuration.potential.widths
    for name, choice in zip(skill.subtasks, learning.potentials, strict=True):
        trial, basin = choice.trial, choice.trial.basin
        at_edge = len(widths) > 1 and trial.width in (min(widths), max(widths))
        lines.append(
            f"{name}: convex program {choice.fit.status}, kernel width {trial.width} m"
            f"{' (at the edge of potential.widths)' if at_edge else ''}, basin "
            f"{basin.share_reached:.1%} of {basin.starts} starts, beyond 90 degrees {trial.beyond_90:.1%}"  # type: ignore[union-attr]
        )
    total = sum(seconds[step] for step in ("preprocessing", "potentials", "metrics"))
    lines.append(f"time: {total:.1f} s of learning, {seconds['metric_loop']:.1f} s of it in the training loop")
    return "\n".join(lines)
