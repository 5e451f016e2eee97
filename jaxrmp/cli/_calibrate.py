"""`jaxrmp calibrate`: where a camera is, by the robot that it saw."""

import argparse
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import ConfigurationError
from .._files import atomic_write
from ..perception import (
    Calibration,
    DepthFrames,
    ObjectTrackerSettings,
    calibrate_camera,
    frames_writer,
    open_frames,
    robot_object,
)
from ._output import progress_bar, tell
from ._poses import check_joints, pose_named, robot_named

_ENOUGH = 5  # postures in which it stands still, so that no others are used
_STILL = 0.02  # rad/s or m/s, below which a robot stands still


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    if arguments.out.suffix not in (".toml", ".npz"):
        raise ConfigurationError(
            f"--out {arguments.out}: expected a .toml, of the pose alone, or .npz, frames and all."
        )
    frames = open_frames(arguments.frames)
    if arguments.guess is None and not frames.posed:
        raise ConfigurationError(
            f"{frames.path} has no T_world_camera: say with --guess x,y,z,roll,pitch,yaw where the camera is, to some "
            "10 cm and 20 degrees."
        )
    guess = frames.camera.T_world_camera if arguments.guess is None else pose_named(arguments.guess, "--guess")
    camera = dataclasses.replace(frames.camera, T_world_camera=np.asarray(guess, float))
    with progress_bar(arguments.quiet) as progress:
        found, chosen = _found(arguments, frames, camera, progress)
    sigma = np.sqrt(np.diag(found.covariance))
    if arguments.out.suffix == ".toml":
        _write_toml(found, len(chosen), arguments.out)
    else:
        _write_frames(frames, found, arguments.out)
    x, y, z = found.T_world_camera[:3, 3]
    print(f"camera at {x:.4f}, {y:.4f}, {z:.4f} m; {int(found.seen.sum())} of {len(chosen)} images show the robot")
    print(
        f"standard deviations {1000 * sigma[:3].max():.1f} mm and {np.degrees(sigma[3:].max()):.2f} degrees at most; "
        f"distances that fit {1000 * found.rms:.1f} mm RMS"
    )
    print(f"written to {arguments.out}")


def _found(arguments: argparse.Namespace, frames: DepthFrames, camera: Any, progress: Any) -> tuple[Calibration, Any]:
    progress("robot", 0.0)
    robot = robot_named(arguments.robot)
    q = check_joints(frames.q, robot, frames.path)
    model = robot_object(robot, looks=not arguments.collision)
    progress("frames", 0.3)
    chosen = _postures(frames.time, q, arguments.postures)
    wanted = set(chosen)
    depths = [depth for k, depth in enumerate(frames.depths()) if k in wanted]
    progress("camera", 0.5)
    return calibrate_camera(model, ObjectTrackerSettings(), np.stack(depths), q[chosen], camera), chosen


def _postures(time: np.ndarray, q: np.ndarray, count: int) -> list[int]:
    """Images of different postures in which the robot stands still, or of any, told, where it does in too few."""
    speed = np.abs(np.diff(q, axis=0)).max(1) / np.diff(time)
    still = np.flatnonzero(np.minimum(np.append(speed, np.inf), np.append(np.inf, speed)) < _STILL)
    chosen = _apart(q, still, count)
    if len(chosen) >= min(count, _ENOUGH):
        return chosen
    if len(more := _apart(q, np.arange(len(q)), count)) > len(chosen):
        tell(
            f"the robot stands still from one image to another in {len(chosen)} postures: others are used, too, and "
            "where it moved, what is not of one moment, joints and image, makes the pose wrong."
        )
        return more
    return chosen


def _apart(q: np.ndarray, of: np.ndarray, count: int) -> list[int]:
    """Some of the images `of`, whose postures differ: each the one farthest from those before."""
    chosen = [int(k) for k in of[:1]]
    while len(chosen) < min(count, len(of)):
        apart = np.abs(q[of, None] - q[None, chosen]).max(2).min(1)
        if apart.max() < 1e-3:
            break
        chosen.append(int(of[np.argmax(apart)]))
    return sorted(chosen)


def _write_toml(found: Calibration, count: int, path: Path) -> None:
    lines = [f"T_world_camera = {json.dumps(found.T_world_camera.tolist())}"]
    lines += ["# Of a displacement, m, and a turn, rad, both in the camera's frame."]
    lines += [f"covariance = {json.dumps(found.covariance.tolist())}"]
    lines += [f"images = {count}", f"images_that_show_the_robot = {int(found.seen.sum())}", f"rms = {found.rms!r}"]
    with atomic_write(path) as file:
        file.write("\n".join(lines).encode() + b"\n")


def _write_frames(frames: DepthFrames, found: Calibration, path: Path) -> None:
    eye = frames.camera
    intrinsics = np.concatenate([np.asarray(eye.focal), np.asarray(eye.middle)])
    scale = None if frames.dtype.kind == "f" else frames.depth_scale
    with frames_writer(path, intrinsics, T_world_camera=found.T_world_camera, depth_scale=scale) as add:
        for k, raw in enumerate(frames.raw()):
            add(raw, float(frames.time[k]), None if frames.q is None else frames.q[k])
