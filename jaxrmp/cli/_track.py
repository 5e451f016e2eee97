"""`jaxrmp track`: where an object was in recorded depth images."""

import argparse
import csv
import dataclasses
import io
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .._counted import counted
from .._errors import ConfigurationError
from .._files import atomic_write
from .._rotations import quaternion_of_rotation
from ..perception import (
    DepthFrames,
    ObjectModel,
    ObjectTrackerSettings,
    object_model,
    open_frames,
    robot_spheres,
    start_estimate,
    track,
)
from ..world import own_spheres, panda_spheres
from ._output import progress_bar, tell, write_arrays
from ._poses import check_joints, pose_named, robot_named

_SLOW = 1.0  # s from image to image, beyond which the unit of time may be another
_MESHES = 0.005  # m, between points of the grids that stand for an object's meshes


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    if arguments.out.suffix not in (".npz", ".csv"):
        raise ConfigurationError(f"--out {arguments.out}: expected a .npz or a .csv.")
    frames = open_frames(arguments.frames)
    if arguments.camera is None and not frames.posed:
        raise ConfigurationError(f"{frames.path} has no T_world_camera: jaxrmp calibrate finds it, then --camera FILE.")
    T = frames.camera.T_world_camera if arguments.camera is None else pose_named(arguments.camera, "--camera")
    camera = dataclasses.replace(frames.camera, T_world_camera=np.asarray(T, float))
    guess = pose_named(arguments.guess, "--guess", "T_world_object")
    with progress_bar(arguments.quiet) as progress:
        arrays, ms = _followed(arguments, frames, camera, guess, progress)
    if arguments.out.suffix == ".npz":
        write_arrays(arrays, arguments.out)
    else:
        _write_csv(arrays, arguments.out)
    lost = arrays["lost"]
    again = int((lost[:-1] & ~lost[1:]).sum()) - int(lost[0] and not lost.all())
    counts = f"{counted(len(lost), 'image')}, {int(lost.sum())} of them lost, found again {counted(again, 'time')}"
    print(f"{counts}, {np.median(ms):.1f} ms an image")
    if len(seen := np.flatnonzero(~lost)):
        fits, rms = np.median(arrays["fits"][seen], axis=0), float(np.median(arrays["rms"][seen]))
        print(
            f"where it was seen: of the pixels looked at for the worst link {100 * fits.min():.0f} % are on it; "
            f"distances {1000 * rms:.1f} mm (RMS)"
        )
    print(f"written to {arguments.out}")
    if lost.all():
        raise ConfigurationError(
            "the object was not found in any image: check --guess, where the camera is, and whether its shapes and "
            "the ranges of its joints are those of what it sees."
        )


def _followed(
    arguments: argparse.Namespace, frames: DepthFrames, camera: Any, guess: np.ndarray, progress: Callable
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    import jax

    progress("model", 0.0)
    model = _model(arguments.object)
    settings = _settings(frames)
    spheres_at = _robot(arguments.robot, frames)
    step = jax.jit(
        lambda estimate, depth, centers, radii: track(model, settings, estimate, depth, camera, centers, radii)
    )
    estimate = start_estimate(model, settings, guess, _joints(arguments.joints, model))
    rows, ms = [], []
    for k, depth in enumerate(frames.depths()):
        progress("images", (k + 1) / len(frames))
        start = time.perf_counter()
        estimate = jax.block_until_ready(step(estimate, depth, *spheres_at(k)))
        ms.append(1000 * (time.perf_counter() - start))
        rows.append([np.asarray(x) for x in (estimate.T_world_object, estimate.q, estimate.qd, estimate.covariance)])
        rows[-1] += [np.asarray(estimate.lost), np.asarray(estimate.fits), np.asarray(estimate.rms)]
    names = ("T_world_object", "q", "qd", "covariance", "lost", "fits", "rms")
    arrays: dict[str, Any] = {"time": frames.time} | dict(
        zip(names, map(np.stack, zip(*rows, strict=True)), strict=True)
    )
    arrays["joint_names"] = np.array(model.robot.joint_names, str)
    return arrays, np.array(ms[min(1, len(ms) - 1) :])


def _model(named: str) -> ObjectModel:
    """The object of `FILE` or `FILE:BODY`."""
    if Path(named).is_file():
        return object_model(named, spacing=_MESHES)
    file, colon, body = named.rpartition(":")
    if not colon or not Path(file).is_file():
        raise ConfigurationError(f"--object {named}: there is no such file. Expected FILE or FILE:BODY, MJCF or URDF.")
    return object_model(file, body, spacing=_MESHES)


def _settings(frames: DepthFrames) -> ObjectTrackerSettings:
    """The tracker's settings, at the images' rate."""
    steps = np.diff(frames.time)
    if not len(steps):
        return ObjectTrackerSettings()
    middle = float(np.median(steps))
    if middle > _SLOW:
        tell(f"the images are {middle:.4g} s apart, by their time: it is in seconds.")
    if gaps := int((steps > 1.5 * middle).sum()):
        tell(f"{counted(gaps, 'image')} came late: the tracker takes all to be {1000 * middle:.0f} ms apart.")
    return ObjectTrackerSettings(rate=1 / middle)


def _robot(named: str | None, frames: DepthFrames) -> Callable[[int], tuple[Any, Any]]:
    """Of image k, the spheres that hold the robot."""
    if named is None:
        if frames.q is not None:
            tell("--robot is not given: what of the robot is seen counts as anything else.")
        nothing = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
        return lambda k: nothing
    import jax

    robot = robot_named(named)
    q = check_joints(frames.q, robot, frames.path)
    spheres = panda_spheres() if named == "panda" else own_spheres(robot)
    at = jax.jit(lambda q: robot_spheres(robot, spheres, q))
    return lambda k: at(q[k].astype(np.float32))


def _joints(named: str | None, model: ObjectModel) -> np.ndarray:
    """The object's joints at first: as said, or 0 as far as they go."""
    if named is None:
        return np.clip(np.zeros(model.num_joints), np.asarray(model.robot.lower), np.asarray(model.robot.upper))
    try:
        q = np.array([float(part) for part in named.split(",")])
    except ValueError as error:
        raise ConfigurationError(f"--joints {named}: {error}. Expected numbers with commas between.") from error
    if len(q) != model.num_joints:
        raise ConfigurationError(f"--joints has {len(q)} numbers, and the object {model.num_joints} joints.")
    lower, upper = np.asarray(model.robot.lower), np.asarray(model.robot.upper)
    for name, value, low, high in zip(model.robot.joint_names, q, lower, upper, strict=True):
        if not low <= value <= high:
            raise ConfigurationError(
                f"--joints: {name} is {value:g}, and goes from {low:.4g} to {high:.4g}, rad or m. Ranges in an MJCF "
                "are in degrees, unless its compiler says otherwise."
            )
    return q


def _write_csv(arrays: dict[str, Any], path: Path) -> None:
    n = len(arrays["joint_names"])
    names = [str(name) for name in arrays["joint_names"]]
    sigma = np.sqrt(np.maximum(np.diagonal(arrays["covariance"], axis1=1, axis2=2), 0))
    turned = ("x", "y", "z", "rx", "ry", "rz")
    head = ["time", "lost", "x", "y", "z", "qw", "qx", "qy", "qz", *names, *(f"speed_{name}" for name in names)]
    head += [f"sigma_{name}" for name in (*turned, *names)]
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(head)
    for k, T in enumerate(arrays["T_world_object"]):
        place = [*T[:3, 3], *quaternion_of_rotation(T[:3, :3])]
        numbers = [*place, *arrays["q"][k], *arrays["qd"][k], *sigma[k, : 6 + n]]
        writer.writerow([repr(float(arrays["time"][k])), int(arrays["lost"][k]), *(f"{x:.7g}" for x in numbers)])
    with atomic_write(path) as file:
        file.write(text.getvalue().encode())
