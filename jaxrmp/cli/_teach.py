"""`jaxrmp teach`: demonstrations by dragging the hand on a page."""

import argparse
from collections.abc import Callable

from ..viewer import Teacher, reach_content
from ._pages import access_of, show
from ._sources import robot_of


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    show(lambda progress: _teacher(arguments, progress), arguments, "Press Record, drag {hand}, press Stop; then Save.")


def _teacher(arguments: argparse.Namespace, progress: Callable[[str, float], None]) -> Teacher:
    progress("reading", 0.0)
    robot = robot_of(arguments.robot, arguments.fix, arguments.frame, arguments.quiet)
    progress("covering", 0.1)
    content = reach_content(robot, arguments.frame, balls=0, self_collision=False)
    progress("drawing", 0.4)
    given = {"overwrite": arguments.overwrite, "port": arguments.port, "access": access_of(arguments)}
    return Teacher(content, arguments.out, arguments.robot, **given)
