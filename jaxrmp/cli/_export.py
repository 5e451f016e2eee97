"""`jaxrmp export`: a skill as a file that other programs run."""

import argparse

from ._export_stablehlo import write_skill_stablehlo
from ._sources import skill_and_robot


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    skill, robot = skill_and_robot(arguments.skill, arguments.robot)
    print(f"wrote {write_skill_stablehlo(skill, robot, arguments.stablehlo)}: qdd of q, qd and T_world_object")
