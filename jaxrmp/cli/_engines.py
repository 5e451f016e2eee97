"""Which engine moves the joints, as named on the command line."""

import argparse
from typing import Any

from .._errors import ConfigurationError
from ..evaluation import skill_problem
from ..kinematics import Robot
from ..learning import Skill
from ..simulation import KinematicEngine, Problem, StopCriteria


def engine_of(arguments: argparse.Namespace, skill: Skill, robot: Robot, criteria: StopCriteria) -> tuple[Any, Problem]:
    """The engine and what it rolls out."""
    if not 0 < arguments.dt < criteria.duration:
        raise ConfigurationError(f"--dt {arguments.dt}: expected more than 0 and less than --duration.")
    problem = skill_problem(skill, robot)
    return KinematicEngine(problem, criteria, dt=arguments.dt), problem
