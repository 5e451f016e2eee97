"""A camera's pose by the robot that it sees: how exactly, from rough guesses, for arms with shapes and with meshes."""

import dataclasses
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from jaxrmp import CalibrationError
from jaxrmp._rotations import pose, rotation_angle, rotation_of_vector
from jaxrmp.kinematics import PANDA_MODEL, Robot, load_robot
from jaxrmp.perception import ObjectTrackerSettings, calibrate_camera, robot_object

from ._posed_robot import posed, scene_of

_FAR, _TURNED = 0.05, np.radians(15.0)  # of the guess, m and rad
_ARMS = {"UR5": "ur_description/urdf/ur5_robot.urdf"}  # of JAXRMP_ROBOTS, with their meshes


def rows(runs: int, postures: int = 8) -> list[dict[str, Any]]:
    """One for the built-in Panda and each arm of meshes that is at hand, the camera at 1 and 2 m, over `runs` seeds."""
    found = {"Panda": load_robot(PANDA_MODEL, fixed={"*finger*": 0.04})}
    folder = Path(os.environ.get("JAXRMP_ROBOTS") or os.devnull)
    found |= {name: load_robot(folder / file) for name, file in _ARMS.items() if (folder / file).is_file()}
    return [_row(name, robot, at, runs, postures) for name, robot in found.items() for at in (1.0, 2.0)]


def _row(name: str, robot: Robot, distance: float, runs: int, postures: int) -> dict[str, Any]:
    model, scene = robot_object(robot), scene_of(robot)
    found = [_one(robot, model, scene, distance, postures, seed) for seed in range(runs)]
    good = np.array([one for one in found if one is not None]).reshape(-1, 4)
    return {
        "name": f"camera at {distance:g} m by {postures} postures of the {name}",
        "runs": runs,
        "told_lost": runs - len(good),
        "camera_rms_mm": 1000 * float(np.sqrt(np.mean(good[:, 0] ** 2))),
        "camera_worst_mm": 1000 * float(good[:, 0].max()),
        "camera_rms_degrees": float(np.degrees(np.sqrt(np.mean(good[:, 1] ** 2)))),
        "camera_worst_degrees": float(np.degrees(good[:, 1].max())),
        "sigmas": float(np.sqrt(np.mean(good[:, 2]) / 6)),
        "cpu_s": float(np.median(good[:, 3])),
    }


def _one(robot: Robot, model: Any, scene: Any, distance: float, postures: int, seed: int) -> Any:
    """Error, m and rad, its square in units of the covariance, and s of CPU; None where it says that it found none."""
    seen = posed(robot, scene, distance, postures, seed)
    way, axis = np.random.default_rng([12, seed]).normal(size=(2, 3))
    T = np.asarray(seen.camera.T_world_camera)
    turn = rotation_of_vector(_TURNED * axis / np.linalg.norm(axis))
    guess = pose(T[:3, 3] + _FAR * way / np.linalg.norm(way), T[:3, :3] @ turn)
    rough = dataclasses.replace(seen.camera, T_world_camera=guess)
    start = time.process_time()
    try:
        found = calibrate_camera(model, ObjectTrackerSettings(), seen.depths, seen.q, rough)
    except CalibrationError:
        return None
    took = time.process_time() - start
    off = np.linalg.inv(T) @ found.T_world_camera
    small = 0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]])
    error = np.append(off[:3, 3], small)
    return (
        np.linalg.norm(error[:3]),
        rotation_angle(off[:3, :3]),
        error @ np.linalg.solve(found.covariance, error),
        took,
    )
