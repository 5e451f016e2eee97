"""Which engine moves the joints, as named on the command line."""

import argparse
import os
import subprocess
import sys
from typing import Any

import numpy as np

from .._errors import ConfigurationError
from ..kinematics import Robot, panda


def needs_fast_xla(arguments: argparse.Namespace) -> bool:
    """Whether this command must start again with XLA set up for MJX on a CPU; see `again_with_fast_xla`."""
    from ..simulation import FAST_ON_CPU

    if arguments.physics != "mjx":
        return False
    return FAST_ON_CPU.split("=")[0] not in os.environ.get("XLA_FLAGS", "")


def again_with_fast_xla(command_line: list[str]) -> int:
    """Run the command in a child process whose XLA runs MJX fast on a CPU, and say so; its exit code.

    XLA reads its flags once, before anything else, so this process may be too late to set them.
    """
    from ..simulation import FAST_ON_CPU

    if "--quiet" not in command_line and "-q" not in command_line:
        print(f"MJX: running in a child process with XLA_FLAGS={FAST_ON_CPU}", file=sys.stderr, flush=True)
    flags = f"{os.environ.get('XLA_FLAGS', '')} {FAST_ON_CPU}".strip()
    command = [sys.executable, "-m", "jaxrmp", *command_line]
    return subprocess.run(command, env={**os.environ, "XLA_FLAGS": flags}, check=False).returncode


def engine_of(arguments: argparse.Namespace, skill: Any, robot: Robot, criteria: Any) -> tuple[Any, Any]:
    """The engine and the problem that it rolls out.

    **Raises** `ConfigurationError` for a robot or a time step that the engine does not have.
    """
    from ..evaluation import scene_problem, skill_problem
    from ..scenes import scene
    from ..simulation import KinematicEngine, MjxEngine, MujocoEngine, arm_alone, arm_in_scene
    from ._run import check_scene

    if not 0 < arguments.dt < criteria.duration:
        raise ConfigurationError(f"--dt {arguments.dt}: expected more than 0 and less than --duration.")
    place = None
    if arguments.scene is not None:
        place = scene(arguments.scene, T_world_object=np.asarray(skill.T_world_object, float))
        check_scene(skill, place.name)
    if (place or arguments.physics != "kinematic") and robot.fingerprint != panda().fingerprint:
        raise ConfigurationError(
            f"scenes and physics have the built-in Panda, and the skill was learned on {robot.name!r}: use "
            "--physics kinematic without --scene."
        )
    problem = skill_problem(skill, robot) if place is None else scene_problem(skill, robot, place)
    if arguments.physics == "kinematic":
        return KinematicEngine(problem, criteria, dt=arguments.dt), problem
    arm = arm_alone() if place is None else arm_in_scene(place)
    if abs(arguments.dt - arm.model.opt.timestep) > 1e-9:
        raise ConfigurationError(f"--dt {arguments.dt}: physics runs in steps of {arm.model.opt.timestep} s.")
    engine = MujocoEngine if arguments.physics == "mujoco" else MjxEngine
    return engine(arm, problem, criteria), problem
