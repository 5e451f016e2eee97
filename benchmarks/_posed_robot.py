"""What a depth camera sees of a robot that takes postures, on a floor, with things about."""

from typing import Any, NamedTuple

import numpy as np

from jaxrmp.kinematics import Robot
from jaxrmp.kinematics._body_poses import body_poses
from jaxrmp.kinematics._mujoco import compile_spec, import_mujoco, read_spec
from jaxrmp.perception import KINECT, Camera, DepthNoise, depth_renderer, measured_depth

_TARGET = np.array([0.25, 0.0, 0.4])
_DRAWN = 4000


class Posed(NamedTuple):
    """Depth images [N, height, width], m, the postures `q` [N, n], and the camera at its true pose."""

    depths: np.ndarray
    q: np.ndarray
    camera: Camera


def scene_of(robot: Robot) -> Any:
    """A MuJoCo model of a `robot` as it looks, on a floor, before a wall, with three boxes on the floor."""
    mujoco: Any = import_mujoco()
    spec = read_spec(robot.source, dict(robot.model.packages), looks=True, physics=False)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    for body in spec.bodies:
        if any(not (g.contype or g.conaffinity) for g in body.geoms):
            for geom in [g for g in body.geoms if g.contype or g.conaffinity]:
                spec.delete(geom)
    world, kinds = spec.worldbody, mujoco.mjtGeom
    world.add_geom(type=kinds.mjGEOM_PLANE, size=[5, 5, 0.1], pos=[0, 0, -0.01])
    for x, y, a in ((0.6, 0.4, 0.1), (-0.5, 0.5, 0.15), (0.2, -0.7, 0.12)):
        world.add_geom(type=kinds.mjGEOM_BOX, size=[a, 0.7 * a, a], pos=[x, y, a - 0.01])
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 640, 480
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 50
    spec.stat.extent = 1.0
    return compile_spec(spec, robot.name)


def posed(
    robot: Robot, model: Any, distance: float, postures: int, seed: int, noise: DepthNoise = KINECT, size=(640, 480)
) -> Posed:
    """A `robot` of a MuJoCo `model` in random postures above the floor and in view of a camera at `distance`, m."""
    mujoco: Any = import_mujoco()
    rng = np.random.default_rng([11, seed])
    turn, up = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(15, 50))
    way = np.array([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
    camera = Camera.looking(_TARGET + distance * way, _TARGET, *size)
    data, images = mujoco.MjData(model), []
    q = _postures(robot, camera, postures, rng)
    with depth_renderer(model, *size) as render:
        for one in q:
            _put(robot, model, data, one)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            images.append(measured_depth(noise, render(data, camera), rng))
    return Posed(np.stack(images), q, camera)


def _put(robot: Robot, model: Any, data: Any, q: np.ndarray) -> None:
    for joint in robot.model.joints:
        own = joint.multiplier * q[joint.coordinate] if joint.coordinate >= 0 else 0.0
        data.joint(joint.name).qpos[0] = own + joint.offset


def _postures(robot: Robot, camera: Camera, count: int, rng: np.random.Generator) -> np.ndarray:
    low, high = (np.clip(np.asarray(b, float), -2.5, 2.5) for b in (robot.lower, robot.upper))
    T = np.linalg.inv(camera.T_world_camera)
    model = robot.model
    moved = [b for b in range(1, len(model.bodies)) if len(model.joints_above(b)) > 1]
    q = rng.uniform(low, high, (_DRAWN, len(low)))
    poses = body_poses(model, q)
    p = np.stack([poses[b][:, :3, 3] for b in moved], axis=1)
    p_camera = p @ T[:3, :3].T + T[:3, 3]
    uv = p_camera[..., :2] / p_camera[..., 2:] * camera.focal + camera.middle
    seen = ((uv > 0) & (uv < (camera.width, camera.height))).all(2) & (p_camera[..., 2] > 0)
    near = np.linalg.norm(p_camera, axis=2).min(1)
    good = np.flatnonzero((p[..., 2] > 0.08).all(1) & (seen.mean(1) > 0.7) & (near > 0.5))
    if len(good) < count:
        raise RuntimeError(f"{len(good)} of {_DRAWN} postures of {robot.name!r} are above the floor and in view.")
    return q[good[:count]]
