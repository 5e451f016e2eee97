"""The arguments of every command. Imports none of the modules that do the work, so that help comes at once."""

import argparse
from pathlib import Path

from .. import __version__
from ..scenes import SCENES

EXIT_CODES = "exit codes: 0 done, 1 an error that the message explains, 2 wrong usage, 130 interrupted"
TASKS = ("drawer_closing", "door_reaching")
_SCENE = f"{', '.join(SCENES)}, or your own: FILE.py or FILE.py:FUNCTION"
DEMOS = "a folder of demonstrations, or synthetic:TASK; default "


def build_parser() -> argparse.ArgumentParser:
    """The parser of `jaxrmp`; `command` is the name of the module in this package whose `run` does the work."""
    parser = argparse.ArgumentParser(
        prog="jaxrmp",
        description="Stable reactive motion policies for robots: learn them from demonstrations, evaluate them, run "
        "them in physics, watch them in the browser.",
        epilog=EXIT_CODES,
    )
    parser.add_argument("--version", action="version", version=f"jaxrmp {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_learn(commands)
    _add_reproduce(commands)
    _add_run(commands)
    _add_evaluate(commands)
    _add_demonstrate(commands)
    _add_view(commands)
    _add_teach(commands)
    _add_completion(commands)
    for command in commands.choices.values():
        command.add_argument("-q", "--quiet", action="store_true", help="show no progress, results and errors only")
    return parser


def _add_learn(commands) -> None:
    parser = commands.add_parser(
        "learn",
        help="learn a skill from demonstrations",
        usage="jaxrmp learn CONFIG [--demos DIR] [--out DIR] [--KEY VALUE ...]",
        description="Learn a skill; write it with its report and pictures. Every key of the configuration can be given "
        "after CONFIG as --KEY VALUE, sections with dots.",
        epilog="example: jaxrmp learn configs/drawer_closing.toml --out out/drawer --metric.updates 500",
    )
    parser.add_argument("config", metavar="CONFIG", help="TOML configuration, such as configs/drawer_closing.toml")
    parser.add_argument("--demos", metavar="DIR", help=DEMOS + "$JAXRMP_DATA/franka/NAME if set, else synthetic")
    parser.add_argument("--out", metavar="DIR", type=Path, help="output folder, default out/NAME")
    parser.add_argument(
        "--json", metavar="FILE", type=Path, help="write the report here as well, with the skill's file"
    )
    parser.set_defaults(takes_overrides=True)


def _add_reproduce(commands) -> None:
    parser = commands.add_parser(
        "reproduce",
        help="roll a skill out from each demonstration's start and measure it",
        description="Kinematic rollouts of the whole policy from each demonstration's first configuration, compared "
        "with that demonstration: DTW, discrete Frechet and final distance of control points in the object's frame.",
        epilog="example: jaxrmp reproduce out/drawer_closing/drawer_closing.skill.npz --json errors.json",
    )
    parser.add_argument("skill", metavar="SKILL", help="skill file written by jaxrmp learn")
    parser.add_argument("--demos", metavar="DIR", help=DEMOS + "those it was learned from")
    parser.add_argument("--robot", metavar="FILE", help="robot file, if it is no longer where the skill was learned")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the errors as JSON")
    parser.add_argument("--save", metavar="FILE", type=Path, help="write the rollouts as NPZ: time_K, q_K, qd_K")
    parser.add_argument("--figures", metavar="DIR", type=Path, help="draw the reproductions")
    parser.add_argument(
        "--targets",
        choices=("own", "skill"),
        default="own",
        help="where the subtasks end: where each demonstration ended (default), or the skill's mean",
    )
    parser.add_argument("--duration", metavar="S", type=float, default=20.0, help="seconds of rollout, default 20")
    parser.add_argument("--dt", metavar="S", type=float, default=0.005, help="seconds a step, default 0.005")


def _add_run(commands) -> None:
    parser = commands.add_parser(
        "run",
        help="run a skill in physics",
        description="Trials in MuJoCo at 1 kHz with contacts and torque limits: first from every demonstration's "
        "start, then with seeded variations of them. What varies and what success is, the scene says: the drawer "
        "closed to 5 mm; the hand at the standoff pose to 1 cm and 10 degrees, nothing touched.",
        epilog="example: jaxrmp run out/drawer_closing/drawer_closing.skill.npz --scene drawer --video out/drawer.mp4",
    )
    parser.add_argument("skill", metavar="SKILL", help="skill file written by jaxrmp learn")
    parser.add_argument("--scene", metavar="SCENE", required=True, help=_SCENE)
    parser.add_argument("--trials", metavar="N", type=int, default=6, help="how many trials, default 6")
    parser.add_argument("--trial", metavar="K", type=int, help="run trial K of these alone: replays it")
    parser.add_argument("--displace", action="store_true", help="move the object by 10 cm during execution")
    parser.add_argument("--demos", metavar="DIR", help=DEMOS + "those it was learned from")
    parser.add_argument(
        "--json", metavar="FILE", type=Path, help="write the outcomes as JSON, and their page beside it"
    )
    parser.add_argument("--html", metavar="FILE", type=Path, help="write the page, default beside --json")
    parser.add_argument("--video", metavar="FILE", type=Path, help="film the first three trials: .mp4 or .gif")
    parser.add_argument("--figures", metavar="DIR", type=Path, help="draw the trials")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="random seed, default 0")
    parser.add_argument("--limit", metavar="S", type=float, default=30.0, help="seconds a trial may take, default 30")
    parser.add_argument("--strict", action="store_true", help="exit with 1 if a trial fails or diverges")
    parser.add_argument(
        "--interface", choices=("torque", "velocity", "position"), default="torque", help="of the arm, default torque"
    )
    parser.add_argument("--learned-rate", metavar="HZ", type=float, help="evaluate learned leaves this often and hold")
    parser.add_argument(
        "--tracker",
        choices=("auto", "on", "off"),
        default="auto",
        help="30 Hz camera with the recordings' noise; auto: if the skill's object is tracked or displaced",
    )
    parser.add_argument("--tracker-delay", metavar="S", type=float, default=0.0, help="seconds, default 0")
    parser.add_argument("--tracker-dropouts", metavar="P", type=float, default=0.0, help="share of frames, default 0")
    parser.add_argument("--tracker-bias", metavar="M", type=float, default=0.0, help="constant error, m, default 0")
    parser.add_argument(
        "--tracker-silent-after",
        metavar="S",
        type=float,
        default=float("inf"),
        help="when it goes silent, default never",
    )


def _add_evaluate(commands) -> None:
    parser = commands.add_parser(
        "evaluate",
        help="roll a skill out from thousands of starts and judge it",
        description="Rollouts of the whole policy from many initial configurations, all at once: how each ends, rest "
        "points away from the goal, energy, clearance, joint limits, and stability as mathematics.",
        epilog="example: jaxrmp evaluate out/drawer_closing/drawer_closing.skill.npz --starts 4096 --json report.json",
    )
    parser.add_argument("skill", metavar="SKILL", help="skill file written by jaxrmp learn")
    parser.add_argument("--starts", metavar="N", type=int, default=4096, help="how many starts, default 4096")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="random seed of the starts, default 0")
    parser.add_argument(
        "--margin", metavar="RAD", type=float, default=0.05, help="distance of starts from joint limits, default 0.05"
    )
    parser.add_argument(
        "--around", metavar="RAD", type=float, help="start within RAD of demonstrated starts, not all over the range"
    )
    parser.add_argument("--demos", metavar="DIR", help="for --around: " + DEMOS + "those it was learned from")
    parser.add_argument("--start-file", metavar="FILE", type=Path, help="NPY file of starts [N, n] instead")
    parser.add_argument(
        "--physics",
        choices=("kinematic", "mujoco", "mjx"),
        default="kinematic",
        help="what moves the joints: the policy itself (default), native MuJoCo, or MJX",
    )
    parser.add_argument("--scene", metavar="SCENE", help=_SCENE + "; default the arm alone")
    parser.add_argument("--robot", metavar="FILE", help="robot file, if it is no longer where the skill was learned")
    parser.add_argument("--dt", metavar="S", type=float, default=0.001, help="seconds a step, default 0.001")
    parser.add_argument(
        "--duration", metavar="S", type=float, default=120.0, help="seconds until a rollout is given up, default 120"
    )
    parser.add_argument(
        "--tolerance", metavar="M", type=float, default=0.01, help="distance from the targets that counts, default 0.01"
    )
    parser.add_argument("--batch", metavar="N", type=int, default=1024, help="starts at a time, default 1024")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the report as JSON, and its page beside it")
    parser.add_argument("--html", metavar="FILE", type=Path, help="write the page, default beside --json")
    parser.add_argument("--strict", action="store_true", help="exit code 1 if any start fails or diverges")
    parser.add_argument("--replay", metavar="INDEX", type=int, help="roll out from this one start again and say how")
    parser.add_argument(
        "--save",
        metavar="FILE",
        type=Path,
        help="write every start and end as NPZ; with --replay its states on the way",
    )
    parser.add_argument("--devices", metavar="N", type=int, help="use N virtual devices on a CPU, such as its cores")
    parser.add_argument("--processes", metavar="N", type=int, default=1, help="share the starts among N processes")
    parser.add_argument("--process", metavar="I", type=int, help="be number I of them (else all are started here)")
    parser.add_argument("--coordinator", metavar="HOST:PORT", help="with --process: where process 0 listens")


def _add_demonstrate(commands) -> None:
    parser = commands.add_parser(
        "demonstrate",
        help="write synthetic demonstrations to a folder",
        description="Write demonstrations of the scripted demonstrator, in the layout that jaxrmp learn --demos reads.",
        epilog="example: jaxrmp demonstrate drawer_closing out/demonstrations",
    )
    parser.add_argument("task", metavar="TASK", help=" or ".join(TASKS))
    parser.add_argument("out", metavar="OUT", type=Path, help="folder to write to")
    parser.add_argument("--count", metavar="N", type=int, default=6, help="how many demonstrations, default 6")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="random seed, default 0")
    parser.add_argument("--overwrite", action="store_true", help="replace demonstrations that are there")


def _add_view(commands) -> None:
    parser = commands.add_parser(
        "view",
        help="watch a policy run live in the browser, drag and push it",
        description="A page on this machine, with the policy running at 1 kHz in it: drag its goal, its object and "
        "obstacles, push the arm, turn gains, switch leaves off, watch its energy. With SKILL a learned one, without a "
        "hand-designed one. Ctrl-C ends it.",
        epilog="example: jaxrmp view out/drawer_closing/drawer_closing.skill.npz --scene drawer",
    )
    parser.add_argument("skill", metavar="SKILL", nargs="?", help="skill file; default a hand-designed policy")
    parser.add_argument("--robot", metavar="FILE", help="MJCF or URDF file, default the Panda, or the skill's robot")
    parser.add_argument("--frame", metavar="FRAME", help="without SKILL: the frame that is taken to the goal")
    parser.add_argument("--scene", metavar="SCENE", help="furniture around the skill: " + _SCENE)
    parser.add_argument("--demos", metavar="DIR", help=DEMOS + "those it was learned from")
    parser.add_argument(
        "--balls", metavar="N", type=int, choices=(0, 1, 2), help="draggable obstacles, default 1, in a scene 0"
    )
    _add_page(parser)


def _add_teach(commands) -> None:
    parser = commands.add_parser(
        "teach",
        help="demonstrate in the browser, with no robot at hand",
        description="A page on this machine on which the robot's hand is dragged: record, replay, discard, mark the "
        "target, and save a set that jaxrmp learn takes, with a configuration beside it. Ctrl-C ends it.",
        epilog="example: jaxrmp teach --robot panda --out out/cup",
    )
    parser.add_argument("--robot", metavar="FILE", default="panda", help="panda (default), or an MJCF or URDF file")
    parser.add_argument("--frame", metavar="FRAME", help="the frame that is dragged, default the hand or the last one")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder to save demonstrations to")
    parser.add_argument("--overwrite", action="store_true", help="replace demonstrations that are there")
    _add_page(parser)


def _add_page(parser) -> None:
    parser.add_argument("--port", metavar="P", type=int, default=8080, help="on 127.0.0.1; default 8080, 0 for any")
    parser.add_argument("--until-closed", action="store_true", help="end when the page is closed, not by Ctrl-C only")


def _add_completion(commands) -> None:
    parser = commands.add_parser(
        "completion",
        help="print a script that makes a shell complete all this",
        description="Print a script that completes commands, options and their values in a shell.",
        epilog="example: jaxrmp completion bash > ~/.local/share/bash-completion/completions/jaxrmp",
    )
    parser.add_argument("shell", metavar="SHELL", choices=("bash", "zsh", "fish"), help="bash, zsh or fish")
