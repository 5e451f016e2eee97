"""`jaxrmp view`: a policy running live on a page."""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from .._errors import ConfigurationError, DemonstrationError
from .._files import read_npz
from ..kinematics import Robot
from ..learning import Demonstration, prepare
from ..learning._demonstrations import check_demonstration
from ..viewer import Content, Recording, Viewer, reach_content, skill_content
from ..viewer._gain_file import with_gains_of
from ..viewer._obstacles import SLOTS
from ..visualization import prepare_headless
from ._camera import camera_spheres, check_looked_for, check_place, scene_camera
from ._output import tell
from ._pages import access_of, show
from ._sources import demonstrations_of, robot_of, scene_of, skill_and_robot


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    check_place(arguments)
    access_of(arguments)
    if arguments.camera:
        if arguments.skill is None or not arguments.scene:
            raise ConfigurationError("--camera looks for the object of a scene: give SKILL and --scene SCENE with it.")
        prepare_headless()
    hint = "Drag the goal of {hand}, push the arm, turn its gains."
    show(lambda progress: _viewer(arguments, progress), arguments, hint)


def _viewer(arguments: argparse.Namespace, progress: Callable[[str, float], None]) -> Viewer:
    progress("reading", 0.0)
    if arguments.skill is None:
        if arguments.scene or arguments.demos:
            raise ConfigurationError("--scene and --demos belong to a skill: give SKILL, or leave them out.")
        balls = 1 if arguments.balls is None else arguments.balls
        robot = robot_of(arguments.robot, arguments.fix, arguments.frame, arguments.quiet)
        progress("covering", 0.1)
        content = reach_content(robot, arguments.frame, balls=balls, slots=_slots(arguments))
        if isinstance(robot, Robot) and not np.allclose(content.q, robot.middle) and not arguments.quiet:
            tell(
                "in the middle of its joints' ranges the arm is stretched out, or touches itself: it starts at a "
                "posture that was found, from which it gets around."
            )
        progress("drawing", 0.4)
        replayed = _recording(arguments.replay, content.policy.robot)
        return Viewer(_tuned(content, arguments), arguments.port, replayed=replayed, access=access_of(arguments))
    if arguments.frame or arguments.fix:
        raise ConfigurationError(
            "--frame and --fix are for the hand-designed policy: a skill has its control points and its robot. Leave "
            "them out."
        )
    skill, robot = skill_and_robot(arguments.skill, arguments.robot)
    place = scene_of(arguments.scene, skill) if arguments.scene else None
    prepared = None
    try:
        prepared = prepare(skill.configuration, robot, demonstrations_of(skill, arguments.demos, robot))
    except DemonstrationError as error:
        if arguments.demos:
            raise
        tell(f"without demonstrations: {error}")
    progress("covering", 0.1)
    balls = (0 if place is not None else 1) if arguments.balls is None else arguments.balls
    content = skill_content(skill, robot, prepared, scene=place, balls=balls, slots=_slots(arguments))
    if place is not None and arguments.camera:
        check_looked_for(place)
        spheres = camera_spheres(skill, place)
        content = content._replace(
            camera=partial(scene_camera, arguments, place, prepared, spheres), camera_spheres=spheres
        )
    progress("drawing", 0.4)
    replayed = _recording(arguments.replay, robot)
    content = _tuned(content, arguments)
    more = {"skill": skill, "prepared": prepared, "replayed": replayed, "access": access_of(arguments)}
    return Viewer(content, arguments.port, **more)


def _tuned(content: Content, arguments: argparse.Namespace) -> Content:
    """The content with the gains of `--gains`."""
    if arguments.gains is None:
        return content
    return content._replace(policy=with_gains_of(content.policy, arguments.gains))


def _slots(arguments: argparse.Namespace) -> int:
    """How many obstacles there can be: none where none are asked for."""
    return 0 if arguments.balls == 0 else SLOTS


def _recording(file: Path | None, robot: Robot) -> Recording | None:
    """The motion of a demo_K.npz, such as a log of `jaxrmp drive`."""
    if file is None:
        return None
    try:
        arrays = read_npz(file)
        time, q = (np.asarray(arrays[name], float) for name in ("time", "joint_positions"))
    except (OSError, ValueError, KeyError) as error:
        raise DemonstrationError(
            f"--replay {file}: expected an NPZ file with time and joint_positions, such as demo_0.npz of a log: {error}"
        ) from error
    if time.ndim != 1 or not len(time):
        raise DemonstrationError(f"--replay {file}: time has shape {time.shape}, expected one number a sample.")
    demonstration = Demonstration(time - time[0], q)
    check_demonstration(demonstration, robot.joint_names, str(file))
    return Recording(demonstration.time, demonstration.q, np.zeros((len(q), 3)))
