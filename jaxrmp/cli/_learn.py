"""`jaxrmp learn`: from a configuration and demonstrations to a skill, a report and pictures."""

import argparse
from pathlib import Path

from ..learning import learn, learning_report, load_configuration, reproduce, save_skill
from ..visualization import save_learning_figures, save_reproduction_figures
from ._output import error_table, made_by, progress_bar, write_json
from ._overrides import parse_overrides
from ._reproduce import result_dict
from ._sources import find_demonstrations, robot_of


def add_parser(commands) -> None:
    parser = commands.add_parser(
        "learn",
        help="learn a skill from demonstrations",
        description="Learn a skill; write it with its report and pictures. Every key of the configuration can be given "
        "as --KEY VALUE, sections with dots.",
        epilog="example: jaxrmp learn configs/drawer_closing.toml --out out/drawer --metric.updates 500",
    )
    parser.add_argument("config", metavar="CONFIG", help="TOML configuration, such as configs/drawer_closing.toml")
    parser.add_argument(
        "--demos", metavar="DIR", help="demonstrations, or synthetic:TASK; default $JAXRMP_DATA, else synthetic ones"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="output folder, default out/NAME")
    parser.set_defaults(run=run, takes_overrides=True)


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    overrides = parse_overrides(rest)
    configuration = load_configuration(arguments.config, overrides)
    robot = robot_of(configuration)
    demonstrations = find_demonstrations(arguments.demos, configuration.name)
    out = arguments.out or Path("out") / configuration.name
    progress = progress_bar()
    learning = learn(configuration, robot, demonstrations, progress)
    skill_file = save_skill(learning.skill, out / f"{configuration.name}.skill.npz")
    progress("reproducing", 0.0)
    reproduction = reproduce(learning.skill, robot, learning.prepared)
    result = result_dict(reproduction)
    write_json({**learning_report(learning), "reproduction": result}, out / "learning_report.json")
    progress("drawing", 0.5)
    save_learning_figures(learning, out / "figures")
    save_reproduction_figures(learning.prepared, reproduction, out / "figures")
    write_json(made_by("learn", configuration, demonstrations.source), out / "made_by.json")
    progress("done", 1.0)
    for name, choice in zip(learning.skill.subtasks, learning.potentials, strict=True):
        print(
            f"{name}: kernel width {choice.trial.width} m, convex program {choice.fit.status}, basin "
            f"{choice.trial.basin.share_reached:.1%} of {choice.trial.basin.starts} starts, "  # type: ignore[union-attr]
            f"beyond 90 degrees {choice.trial.beyond_90:.1%}"
        )
    print(error_table(result["per_demo"], result["mean"]))
    print(f"learned from {demonstrations.source} in {sum(list(learning.seconds.values())[:3]):.1f} s: {skill_file}")
