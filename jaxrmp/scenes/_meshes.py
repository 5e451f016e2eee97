"""The Panda's looks, from a model of MuJoCo Menagerie, for pictures alone: nothing is downloaded, physics stays."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import RobotError
from .._rotations import pose, quaternion_of_rotation, rotation_of_quaternion
from ..kinematics import panda
from ..kinematics._mujoco import import_mujoco
from ._looks import add_looks
from ._parts import FINGER_WIDTH
from ._scene import Scene

_BODIES = {f"panda_link{i}": f"link{i}" for i in range(8)} | {
    "panda_hand": "hand",
    "panda_leftfinger": "left_finger",
    "panda_rightfinger": "right_finger",
}
_SEEN = 2  # group of the geometries that are there to be looked at


def panda_meshes() -> Path | None:
    """The MJCF file of mujoco-menagerie's Panda, where that package is installed and has fetched it; None elsewhere.

    `python -m mujoco_menagerie prefetch franka_emika_panda` fetches it, or set `MENAGERIE_ROOT` to a checkout of
    MuJoCo Menagerie, for which the package is not needed.
    """
    root = os.environ.get("MENAGERIE_ROOT")
    if root:
        file = Path(root) / "franka_emika_panda" / "panda.xml"
        return file if file.exists() else None
    try:
        import mujoco_menagerie  # type: ignore[import-not-found]
    except ImportError:
        return None
    cache, robot = mujoco_menagerie.Cache(), mujoco_menagerie.get("franka_emika_panda")
    return Path(cache.model_path(robot)) / "panda.xml" if cache.is_cached(robot) else None


def picture_model(place: Scene, meshes: str | os.PathLike | None = None, *, smooth: bool = False) -> Any:
    """The model of the scene `place` as it is drawn: with tiles on its floor and light from two sides, and the Panda
    with the looks of Menagerie's where they are at hand.

    States of one are states of the other. Meshes are put where their model has them while all joints are at zero and
    the fingers at `FINGER_WIDTH`, so that the frames of the two may differ. They touch nothing and weigh nothing; the
    arm's own geometry becomes invisible.

    **Arguments**: `meshes`, the MJCF file, by default `panda_meshes()`; `smooth`, edges without steps, in twice
    the time.
    **Raises** `RobotError` for a file that cannot be read or has not the bodies of Menagerie's Panda.
    """
    if meshes is None:
        meshes = panda_meshes() if place.robot.fingerprint == panda().fingerprint else None
    spec, mujoco = place.spec.copy(), import_mujoco()
    add_looks(spec, smooth)
    if meshes is None:
        return spec.compile()
    try:
        theirs = mujoco.MjSpec.from_file(str(meshes))
        places = _body_poses(theirs.compile(), FINGER_WIDTH)
    except ValueError as error:
        raise RobotError(f"{str(meshes)!r} cannot be read as an MJCF model: {error}") from error
    if missing := sorted(set(_BODIES.values()) - set(places)):
        raise RobotError(f"{str(meshes)!r} is not Menagerie's Panda: it has no bodies {', '.join(missing)}.")
    ours = _body_poses(spec.compile(), 0.0)
    folder = Path(meshes).parent / (theirs.meshdir or "")
    found = {mesh.name or Path(mesh.file).stem: mesh for mesh in theirs.meshes}
    for material in theirs.materials:
        spec.add_material(name=f"mesh_{material.name}", rgba=material.rgba, specular=0.4, shininess=0.3)
    for own_name, name in _BODIES.items():
        body = spec.body(own_name)
        T_own_theirs = np.linalg.inv(ours[own_name]) @ places[name]
        seen = [g for g in theirs.body(name).geoms if g.group == _SEEN and g.type == mujoco.mjtGeom.mjGEOM_MESH]
        if seen:
            for geom in body.geoms:
                geom.rgba = [*geom.rgba[:3], 0.0]
        for geom in seen:
            mesh = found[geom.meshname]
            if spec.mesh(f"mesh_{geom.meshname}") is None:
                spec.add_mesh(name=f"mesh_{geom.meshname}", file=str((folder / mesh.file).resolve()), scale=mesh.scale)
            T = T_own_theirs @ pose(geom.pos, rotation_of_quaternion(geom.quat))
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=f"mesh_{geom.meshname}",
                material=f"mesh_{geom.material}" if geom.material else "",
                rgba=geom.rgba,
                pos=T[:3, 3],
                quat=quaternion_of_rotation(T[:3, :3]),
                mass=0.0,
                contype=0,
                conaffinity=0,
                group=_SEEN,
            )
    return spec.compile()


def _body_poses(model: Any, finger: float) -> dict[str, np.ndarray]:
    """Poses [4, 4] of all bodies with the joints at zero and fingers, if they slide, at `finger`, m."""
    mujoco = import_mujoco()
    data = mujoco.MjData(model)
    data.qpos[:] = 0
    for j in range(model.njnt):
        if "finger" in model.joint(j).name:
            data.qpos[model.jnt_qposadr[j]] = finger
    mujoco.mj_kinematics(model, data)
    poses = pose(data.xpos, rotation_of_quaternion(data.xquat))
    return {model.body(b).name: T for b, T in enumerate(poses)}
