"""`jaxrmp teach`: demonstrations by dragging the hand on a page."""

import argparse

from ..viewer import Teacher, reach_content
from ._pages import show


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    content = reach_content(arguments.robot, arguments.frame, balls=0, self_collision=False)
    teacher = Teacher(content, arguments.out, arguments.robot, overwrite=arguments.overwrite, port=arguments.port)
    show(teacher, arguments.until_closed, "Press Record, drag the hand, press Stop; then Save.")
