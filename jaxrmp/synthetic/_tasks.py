"""What the scripted demonstrator does: the via poses of each task, on the scale of the paper's experiments."""

from typing import NamedTuple

import numpy as np

from .._rotations import pose
from ._motion import HandMotion, Rotation, through

_SHOULDER = np.array([0.0, 0.0, 0.333])


class TaskScript(NamedTuple):
    """One motion, the postures [2, 7] that the arm leans to at its start and end, and the tracked object's pose."""

    motion: HandMotion
    postures: np.ndarray
    object_poses: dict[str, np.ndarray]


def drawer_closing(rng: np.random.Generator, place: np.ndarray) -> TaskScript:
    """From a start to the drawer's front with the wrist aligned, then along a straight line until it is closed.

    No object is tracked. `place` [3] in the unit cube says where it starts.
    """
    closed = np.array([0.643, -0.435, 0.235]) + rng.normal(0.0, 0.008, 3)
    front = closed - 0.20 * np.array([0.58, -0.81, 0.0]) + rng.normal(0.0, 0.006, 3)
    start = np.array([0.15, -0.22, 0.28]) + place * [0.42, 0.38, 0.28]
    start += max(0.0, 0.55 / np.linalg.norm(start - closed) - 1.0) * (start - closed)  # at least 0.55 m to go
    corner = 0.5 * (start + front) + [-0.02, 0.02, 0.02] + rng.normal(0.0, 0.02, 3)
    aligned = _axes(x=[-0.2, -0.98, 0.0], z=[0.0, 0.0, -1.0])
    start_turn = Rotation.from_euler("zxy", rng.normal(0.0, [0.25, 0.06, 0.06]))
    on_the_way = Rotation.from_euler("zxy", rng.normal(0.0, [0.10, 0.04, 0.04]))
    rotations = [start_turn * aligned, on_the_way * aligned, aligned, aligned]
    motion = through([start, corner, front, closed], rotations, rng.uniform(0.08, 0.13), 0.45, rng)
    postures = np.array([[-0.6, -0.6, 0.2, -2.4, 0.1, 1.8, 1.1], [-0.75, 0.85, 0.3, -1.1, -0.3, 1.95, 1.3]])
    postures[:, [0, 2]] += rng.normal(0.0, 0.2) * np.array([1.0, -1.0])  # the redundant joint, held as it happens to be
    return TaskScript(motion, postures, {})


def door_reaching(rng: np.random.Generator, place: np.ndarray) -> TaskScript:
    """From inside a cabinet in a C-shaped arc round the edge of its open door to a standoff before the door's handle.

    The door stands a little differently every time. `place` [3] in the unit cube says where the hand starts.
    """
    nominal = Rotation.from_euler("z", -128.0, degrees=True)
    door = Rotation.from_euler("z", rng.normal(0.0, 3.0), degrees=True) * nominal
    handle = np.array([0.02, -0.43, 0.765]) + rng.normal(0.0, [0.015, 0.015, 0.008])
    turned = door * nominal.inv()  # everything that belongs to the door turns with it
    start = np.array([0.48, -0.50, 0.79]) + place * [0.22, 0.25, 0.19]
    start = _SHOULDER + min(1.0, 0.86 / np.linalg.norm(start - _SHOULDER)) * (start - _SHOULDER)  # within reach
    inside = np.array([0.33, 0.22, 0.20]) + [0.0, 0.3 * (start[1] + 0.4), 0.4 * (start[2] - 0.88)]
    arc = [inside, [0.05, 0.30, 0.23], [-0.15, 0.13, 0.16], [-0.11, -0.01, 0.07], [-0.015, -0.046, 0.038]]
    arc = handle + turned.apply(np.array(arc) + rng.normal(0.0, [[0.02], [0.02], [0.015], [0.008], [0.003]], (5, 3)))
    at_handle = turned * _axes(x=[0.0, -0.75, 0.65], z=[0.98, -0.12, -0.1])
    in_cabinet = _axes(x=[-0.3, -0.7, 0.65], z=[0.8, -0.5, -0.1])
    in_cabinet = Rotation.from_euler("zyx", rng.normal(0.0, [0.15, 0.15, 0.1])) * in_cabinet
    turn = (in_cabinet.inv() * at_handle).as_rotvec()
    rotations = [in_cabinet * Rotation.from_rotvec(s * turn) for s in (0.0, 0.1, 0.25, 0.6, 0.85, 1.0)]
    motion = through([start, *arc], rotations, rng.uniform(0.13, 0.18), 0.5, rng)
    postures = np.array([[-0.3, 0.35, -0.3, -0.85, 0.05, 2.5, 0.9], [0.25, -1.3, -0.75, -1.57, -0.15, 1.95, 0.2]])
    return TaskScript(motion, postures, {"door_handle": pose(handle, door.as_matrix())})


def _axes(x, z) -> Rotation:
    """The rotation whose z axis is `z` and whose x axis is as near to `x` as can be."""
    z = np.asarray(z, float) / np.linalg.norm(z)
    x = np.asarray(x, float) - np.dot(x, z) * z
    x /= np.linalg.norm(x)
    return Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=1))
