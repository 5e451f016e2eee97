"""The depth camera of `run` and `view --camera depth`: where it stands, what it knows of the robot, its report."""

import argparse
import contextlib
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np

from .._errors import ConfigurationError, NoGeometryError
from ..learning import PreparedDemonstrations, Skill
from ..perception import Camera, DepthTracker, ObjectModel, depth_tracker, looked_at, object_model, overhead_camera
from ..perception._depth_tracker import check_names
from ..scenes import Scene
from ..simulation import TrackerSettings
from ..world import RobotSpheres, own_spheres
from ._output import tell

_INSTANTS = 12  # of each demonstration, at which the arm may hide the object
_OF_NOISE = ("delay", "dropouts", "bias", "silent_after")  # of `TrackerSettings`, with an argument each


def check_camera(arguments: argparse.Namespace) -> None:
    """**Raises** `ConfigurationError` for arguments of a camera and of the tracker without one together."""
    default = TrackerSettings()
    given = ["--tracker"] if arguments.tracker != "auto" else []
    for name in _OF_NOISE:
        if getattr(arguments, f"tracker_{name}") != getattr(default, name):
            given.append(f"--tracker-{name.replace('_', '-')}")
    if arguments.camera and given:
        raise ConfigurationError(
            f"--camera {arguments.camera} sees the object itself, and {', '.join(given)} models how it is seen: give "
            "one of both."
        )
    check_place(arguments)


def check_place(arguments: argparse.Namespace) -> None:
    """**Raises** `ConfigurationError` for a camera's place without a camera, or two places."""
    if not arguments.camera and (arguments.camera_distance is not None or arguments.camera_at is not None):
        raise ConfigurationError("--camera-distance and --camera-at place a camera: add --camera depth.")
    if arguments.camera_distance is not None and arguments.camera_at is not None:
        raise ConfigurationError("--camera-distance and --camera-at: give one of both.")


def check_looked_for(scene: Scene) -> None:
    """**Raises** `ConfigurationError` for a scene without an object."""
    if not scene.object:
        raise ConfigurationError(f"--camera depth: scene {scene.name!r} has no object to look for. Run it without.")


def noise_of(arguments: argparse.Namespace) -> TrackerSettings:
    """The tracker's noise as the command line has it."""
    return TrackerSettings(**{name: getattr(arguments, f"tracker_{name}") for name in _OF_NOISE})


@contextlib.contextmanager
def scene_camera(
    arguments: argparse.Namespace,
    scene: Scene,
    prepared: PreparedDemonstrations | None,
    spheres: RobotSpheres | None,
) -> Iterator[DepthTracker]:
    """Within it, a depth camera over the object of a `scene`, from where the demonstrations of a skill hide it least,
    if they are at hand; `spheres` hold the robot (`camera_spheres`).

    **Raises** `ConfigurationError` for a scene without an object, `NoGeometryError` for shapes that cannot be seen.
    """
    check_looked_for(scene)
    model = object_model(scene.model, scene.object)
    check_names(scene, model)
    camera = _placed(arguments, model, scene, prepared, spheres)
    with depth_tracker(scene, model, camera, spheres) as tracker:
        yield tracker


def camera_report(camera: DepthTracker, scene: Scene, prepared: PreparedDemonstrations) -> dict[str, Any]:
    """Where a `camera` stands and what it is like, as JSON has it."""
    eye = np.asarray(camera.camera.T_world_camera, float)[:3, 3]
    target = looked_at(camera.model, prepared.poses, _at_first(camera.model, scene))
    return {
        "at_m": eye.tolist(),
        "looks_at_m": target.tolist(),
        "distance_m": float(np.linalg.norm(eye - target)),
        "above_deg": float(np.degrees(np.arcsin((eye - target)[2] / np.linalg.norm(eye - target)))),
        "width": camera.camera.width,
        "height": camera.camera.height,
        "rate_hz": camera.settings.rate,
    }


def _placed(
    arguments: argparse.Namespace,
    model: ObjectModel,
    scene: Scene,
    prepared: PreparedDemonstrations | None,
    spheres: RobotSpheres | None,
) -> Camera:
    q = _at_first(model, scene)
    poses = scene.T_world_object[None] if prepared is None else np.asarray(prepared.poses, float)
    if arguments.camera_at is not None:
        try:
            eye = [float(number) for number in arguments.camera_at.split(",")]
        except ValueError:
            eye = []
        if len(eye) != 3 or not np.isfinite(eye).all():
            raise ConfigurationError(f"--camera-at {arguments.camera_at!r}: expected X,Y,Z, m, such as 0.5,-1.2,1.5.")
        return Camera.looking(eye, looked_at(model, poses, q))
    distance = 1.0 if arguments.camera_distance is None else arguments.camera_distance
    if spheres is None or prepared is None:
        return overhead_camera(model, poses, q, distance=distance)
    points = jax.jit(jax.vmap(spheres.points(scene.robot)))
    rows = [path[np.linspace(0, len(path) - 1, _INSTANTS).round().astype(int)] for path in prepared.joints.q]
    centers = np.stack([np.asarray(points(np.asarray(row, np.float32))) for row in rows])
    return overhead_camera(model, poses, q, centers, np.asarray(spheres.radii), distance=distance)


def _at_first(model: ObjectModel, scene: Scene) -> np.ndarray:
    """The object's joints as a trial begins."""
    data = scene.fresh()
    return np.array([data.joint(name).qpos[0] for name in model.robot.joint_names])


def camera_spheres(skill: Skill, scene: Scene) -> RobotSpheres | None:
    """Spheres that hold the robot as a camera sees it; None, told, where it has no geometry."""
    try:
        return own_spheres(scene.robot, skill.frames[0])
    except NoGeometryError as error:
        tell(f"--camera depth: what the camera sees of the arm may be taken for the object: {error}")
        return None
