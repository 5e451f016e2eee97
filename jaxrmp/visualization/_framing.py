"""A camera that has in view all that moves in a run, as near as that allows."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..kinematics._mujoco import import_mujoco

_AWAY = np.array([0.75, -0.75, 0.5])  # from what is looked at to the camera, where the scene has no view of its own
_MARGIN = 1.12
_RADIUS = 0.02  # m, least that a geometry takes


def framing(model: Any, states: Sequence[Any], part: tuple[float, float]) -> Any:
    """A `mujoco.MjvCamera` that holds all geometries but planes of `model` in each of `states`, `mujoco.MjData`.

    It looks from where the model's camera "view" does, if it has one, as it was named, or else from the front right and
    above. `part`, the height and the width of what it is to hold them in, round the middle, in heights of the picture.
    """
    mujoco = import_mujoco()
    solid = np.flatnonzero((model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_rgba[:, 3] > 0))
    centers = np.concatenate([data.geom_xpos[solid] for data in states])
    radii = np.tile(np.maximum(model.geom_rbound[solid], _RADIUS), len(states))
    names = [model.camera(c).name for c in range(model.ncam)]
    away = states[0].cam_xmat[names.index("view")].reshape(3, 3)[:, 2] if "view" in names else _AWAY
    away = away / np.linalg.norm(away)
    right = np.cross([0.0, 0.0, 1.0], away)
    right /= np.linalg.norm(right)
    up = np.cross(away, right)
    slope = np.tan(np.radians(model.vis.global_.fovy) / 2) / _MARGIN
    # Along each side of the picture, where a plane through the camera just holds all: between two of them it stands.
    middle, far = np.zeros(3), 0.0
    depth = centers @ away
    for axis, share in ((right, slope * part[1]), (up, slope * part[0])):
        side, reach = centers @ axis, radii * np.sqrt(1 + share**2)
        high, low = (side + share * depth + reach).max(), (side - share * depth - reach).min()
        middle += axis * (high + low) / 2
        far = max(far, (high - low) / (2 * share))
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    at = float(np.median(depth))
    camera.lookat, camera.distance = middle + away * at, far - at
    camera.azimuth = np.degrees(np.arctan2(-away[1], -away[0]))
    camera.elevation = -np.degrees(np.arcsin(away[2]))
    return camera
