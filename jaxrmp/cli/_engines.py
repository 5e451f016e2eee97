"""Which engine moves the joints, as named on the command line."""

import argparse
from typing import Any

from .._errors import ConfigurationError
from ..kinematics import Robot


def engine_of(arguments: argparse.Namespace, skill: Any, robot: Robot, criteria: Any) -> tuple[Any, Any]:
    """The engine and the problem that it rolls out.

    **Raises** what `scene_of` and `arm_alone` raise, `ConfigurationError` for a time step that the engine does not
    have.
    """
    from ..evaluation import scene_problem, skill_problem
    from ..scenes import arm_alone
    from ..simulation import KinematicEngine, MjxEngine, MujocoEngine
    from ._sources import scene_of

    if not 0 < arguments.dt < criteria.duration:
        raise ConfigurationError(f"--dt {arguments.dt}: expected more than 0 and less than --duration.")
    place = None if arguments.scene is None else scene_of(arguments.scene, skill)
    problem = skill_problem(skill, robot) if place is None else scene_problem(skill, place.robot, place)
    if arguments.physics == "kinematic":
        return KinematicEngine(problem, criteria, dt=arguments.dt), problem
    place = place or arm_alone(skill.configuration.robot, robot)
    if abs(arguments.dt - place.model.opt.timestep) > 1e-9:
        raise ConfigurationError(f"--dt {arguments.dt}: physics runs in steps of {place.model.opt.timestep} s.")
    engine = MujocoEngine if arguments.physics == "mujoco" else MjxEngine
    return engine(place, problem, criteria), problem
