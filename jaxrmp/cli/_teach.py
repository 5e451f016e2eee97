"""`jaxrmp teach`: demonstrations by dragging the hand on a page."""

import argparse

from ..viewer import Teacher, reach_content
from ._pages import show
from ._sources import robot_of


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    robot = robot_of(arguments.robot, arguments.fix)
    content = reach_content(robot, arguments.frame, balls=0, self_collision=False)
    teacher = Teacher(content, arguments.out, arguments.robot, overwrite=arguments.overwrite, port=arguments.port)
    show(teacher, arguments.until_closed, "Press Record, drag the hand, press Stop; then Save.")
