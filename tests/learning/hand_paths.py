"""Paths of a hand that turns by more than a right angle, as values and as files of poses."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxrmp._rotations import quaternion_of_rotation, rotation_of_vector
from jaxrmp.kinematics import forward_kinematics, panda
from jaxrmp.learning import PoseDemonstration, PoseDemonstrationSet

START = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])


def configuration_of(name, kind):
    """The text of a configuration of a cup that is poured, for files as `written`."""
    return f"""
name = "{name}"
flow.updates = 300
recording = {{ units = "cm", quaternion = "wxyz", rate = 30 }}

[[subtasks]]
name = "cup"
frame = "panda_hand"
kind = "{kind}"

[poses]
start = {START.tolist()}
"""


def hand(q, frame="panda_hand"):
    with jax.enable_x64(True):
        return np.asarray(jax.vmap(lambda q: forward_kinematics(panda(), q, frame))(jnp.asarray(q)))


def pour(k, samples=90):
    """A hand that goes 0.5 m round a bow, lifts, and is turned by 110 degrees meanwhile: poses [T, 4, 4]."""
    s = np.linspace(0, 1, samples)[:, None]
    T = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (samples, 1, 1))  # the hand down
    start, end = np.array([0.45, -0.25 + 0.02 * k, 0.35 + 0.02 * k]), np.array([0.5, 0.2, 0.4])
    T[:, :3, 3] = start + s * (end - start) + np.sin(np.pi * s) * [0.08, 0.0, 0.05 + 0.01 * k]
    T[:, :3, :3] = rotation_of_vector(np.deg2rad(110) * (1 - s**1.5) * [0.0, 1.0, 0.05 * k]) @ T[:, :3, :3]
    return T


def written(folder, name="pour.npz", flips=False):
    arrays = {}
    for k in range(4):
        T = pour(k)
        wxyz = quaternion_of_rotation(T[:, :3, :3])
        if flips:
            wxyz = wxyz * np.where(np.arange(len(T)) % 7 > 3 + k % 2, -1.0, 1.0)[:, None]
        arrays |= {f"positions_{k}": 100 * T[:, :3, 3], f"quaternions_{k}": wxyz}
    np.savez(folder / name, **arrays)
    return folder / name


def as_set(ways, poses=None):
    demonstrations = [
        PoseDemonstration(np.arange(len(T)) / 30, T[:, :3, 3], quaternion_of_rotation(T[:, :3, :3]), poses or {})
        for T in ways
    ]
    return PoseDemonstrationSet(tuple(demonstrations))
