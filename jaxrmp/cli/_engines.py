"""Which engine moves the joints, as named on the command line."""

import argparse
import os
import subprocess
import sys
from typing import Any

from .._errors import ConfigurationError, RolloutError
from ..kinematics import Robot


def again_with_fast_xla(arguments: argparse.Namespace) -> bool:
    """Run the command in a child process whose XLA runs MJX fast on a CPU, and say so, if that is needed: whether it
    was.

    XLA reads its flags once, before anything else, so this process may be too late to set them.
    **Raises** `RolloutError` if it fails.
    """
    from ..simulation import FAST_ON_CPU

    given = os.environ.get("XLA_FLAGS", "")
    if arguments.physics != "mjx" or FAST_ON_CPU.split("=")[0] in given:
        return False
    if not arguments.quiet:
        print(f"MJX: running in a child process with XLA_FLAGS={FAST_ON_CPU}", file=sys.stderr, flush=True)
    command = [sys.executable, "-m", "jaxrmp", *arguments.command_line]
    environment = {**os.environ, "XLA_FLAGS": f"{given} {FAST_ON_CPU}".strip()}
    if code := subprocess.run(command, env=environment, check=False).returncode:
        raise RolloutError(f"the child process ended with exit code {code}; see above.")
    return True


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
