"""`jaxrmp demonstrate`: write the scripted demonstrator's demonstrations to a folder."""

import argparse
from pathlib import Path

from ..synthetic import SYNTHETIC_TASKS, write_synthetic_demonstrations


def add_parser(commands) -> None:
    parser = commands.add_parser(
        "demonstrate",
        help="write synthetic demonstrations to a folder",
        description="Write demonstrations of the scripted demonstrator, in the layout that jaxrmp learn --demos reads.",
        epilog="example: jaxrmp demonstrate drawer_closing out/demonstrations",
    )
    parser.add_argument("task", metavar="TASK", help=f"one of {', '.join(SYNTHETIC_TASKS)}")
    parser.add_argument("out", metavar="OUT", type=Path, help="folder to write to")
    parser.add_argument("--count", metavar="N", type=int, default=6, help="how many demonstrations, default 6")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="random seed, default 0")
    parser.add_argument("--overwrite", action="store_true", help="replace demonstrations that are there")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    write_synthetic_demonstrations(
        arguments.task, arguments.out, seed=arguments.seed, count=arguments.count, overwrite=arguments.overwrite
    )
    print(f"wrote {arguments.count} demonstrations of {arguments.task} to {arguments.out}")
