"""What a depth camera sees of a scene: an object whose joint moves, and an arm that crosses the view."""

import functools
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from jaxrmp import scenes
from jaxrmp.kinematics._mujoco import import_mujoco
from jaxrmp.perception import KINECT, Camera, DepthNoise, depth_renderer, measured_depth
from jaxrmp.world import panda_spheres

RATE = 30.0
_TRIED = 3000
_PERIOD = 5.0  # of the arm's crossing, s


class Watched(NamedTuple):
    """A scene, the camera over it, the body of the object, a geometry of it that counts, and its joint's range here."""

    scene: Any
    camera: Camera
    body: str
    handle: str
    low: float
    high: float


class Seen(NamedTuple):
    """One image: its `time`, s; `depth` [height, width], m; the arm's joints `q` [n]; and the truth: the object's pose
    [4, 4], its joint, and where the handle is [3]."""

    time: float
    depth: np.ndarray
    q: np.ndarray
    T_world_object: np.ndarray
    joint: float
    handle: np.ndarray


@functools.cache
def watched(name: str, distance: float) -> Watched:
    """The `name`d scene with a camera overhead, at `distance`, m, from its handle, 50 degrees above it."""
    scene: Any = scenes.scene(name)
    handle, azimuth, low, high = {
        "door": ("door_handle", -120.0, 0.1, 1.1),
        "drawer": ("drawer_handle", -55.0, 0.0, 0.2),
    }[name]
    data = _forward(scene, scene.fresh())
    target, turn, up = data.geom(handle).xpos.copy(), np.radians(azimuth), np.radians(50.0)
    way = np.array([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), -np.sin(up)])
    return Watched(scene, Camera.looking(target - distance * way, target), "object", handle, low, high)


@functools.cache
def crossing(name: str, distance: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Two configurations of the arm between which it crosses the view of what the joint moves, touching nothing, and
    the share of that which the second hides."""
    at = watched(name, distance)
    rng, scene = np.random.default_rng(0), at.scene
    low, high = np.asarray(scene.robot.lower), np.asarray(scene.robot.upper)
    drawn = rng.uniform(low, high, (_TRIED, len(low)))
    shares = np.array([_hidden(at, q) for q in drawn])
    for k in np.argsort(-np.where(shares < 0.7, shares, 0))[:100]:
        before = drawn[k]
        if _touches(at, before[None]):
            continue
        for away in np.clip(before + rng.uniform(-1, 1, (60, len(low))), low, high):
            if _hidden(at, away) < 0.02 and not _touches(at, before + np.linspace(0, 1, 12)[:, None] * (away - before)):
                return away, before, float(shares[k])
    raise RuntimeError(f"no way of the arm across the view of the {name} at {distance} m touches nothing.")


def sequence(
    at: Watched,
    seed: int,
    seconds: float,
    *,
    shut: bool = False,
    moved: tuple[float, np.ndarray] | None = None,
    hidden: tuple[float, float] = (0.0, 0.0),
    distance: float = 1.0,
    noise: DepthNoise = KINECT,
) -> Iterator[Seen]:
    """Images at 30 Hz of the joint swinging, or being pushed `shut` again and again, and the arm crossing.

    `moved`, a time, s, from when on the object is at another pose [4, 4]; `hidden`, from when to when a board is right
    before the camera, s.
    """
    scene, rng = at.scene, np.random.default_rng([7, seed])
    away, before, _ = crossing(scene.name, distance)
    phases, data = rng.uniform(0, 2 * np.pi, 4), scene.fresh()
    T = np.array(scene.T_world_object)
    with depth_renderer(scene.model, at.camera.width, at.camera.height) as render:
        for k in range(round(seconds * RATE)):
            t = k / RATE
            if moved is not None and t >= moved[0]:
                T = moved[1]
                scene.move_object(data, T)
            swing = 0.65 * np.sin(2 * np.pi * 0.2 * t + phases[0]) + 0.35 * np.sin(2 * np.pi * 0.45 * t + phases[1])
            if shut:  # four seconds to push it shut, two to have it opened again
                part = (t + 6 * phases[0] / (2 * np.pi)) % 6.0
                swing = np.cos(np.pi * part / 4) if part < 4 else -np.cos(np.pi * (part - 4) / 2)
            joint = 0.5 * (at.low + at.high) + 0.5 * (at.high - at.low) * swing
            q = away + (0.5 - 0.5 * np.cos(2 * np.pi * t / _PERIOD + phases[2])) * (before - away)
            data.joint(scene.joint).qpos[0], data.qpos[scene.arm_qpos] = joint, q
            _forward(scene, data)
            depth = measured_depth(noise, render(data, at.camera), rng)
            if hidden[0] <= t < hidden[1]:
                depth = np.where(depth > 0, np.float32(0.5), np.float32(0))
            yield Seen(t, depth, q, T, joint, data.geom(at.handle).xpos.copy())


def _forward(scene: Any, data: Any) -> Any:
    mujoco: Any = import_mujoco()
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_camlight(scene.model, data)
    return data


def _touches(at: Watched, path: np.ndarray) -> bool:
    """Whether the arm touches anything on a path [T, n], wherever the joint is."""
    mujoco: Any = import_mujoco()
    data, scene = at.scene.fresh(), at.scene
    for q in path:
        for joint in np.linspace(at.low, at.high, 6):
            data.qpos[scene.arm_qpos], data.joint(scene.joint).qpos[0] = q, joint
            mujoco.mj_kinematics(scene.model, data)
            mujoco.mj_collision(scene.model, data)
            a, b = data.contact.geom[data.contact.dist < 0].T
            if (scene.of_arm[a] | scene.of_arm[b]).any() and scene.contacts(data):
                return True
            of_object = np.isin(scene.model.geom_bodyid, _below(scene.model, at.body))
            if (scene.of_arm[a] & of_object[b] | scene.of_arm[b] & of_object[a]).any():
                return True
    return False


def _below(model: Any, body: str) -> list[int]:
    found = [model.body(body).id]
    for b in range(found[0] + 1, model.nbody):
        found += [b] if int(model.body_parentid[b]) in found else []
    return found


def _hidden(at: Watched, q: np.ndarray) -> float:
    """The share of points round the handle that the arm at `q` hides from the camera."""
    ends, eye = _around(at.scene.name, at.handle), np.asarray(at.camera.T_world_camera)[:3, 3]
    centers, radii = _arm(at.scene, q)
    way = ends - eye
    t = np.clip(((centers[:, None] - eye) * way).sum(-1) / (way * way).sum(-1), 0, 0.97)
    gap = np.linalg.norm(eye + t[..., None] * way - centers[:, None], axis=-1)
    inside = np.linalg.norm(centers - eye, axis=1) < radii + 0.1  # the arm is not to be pushed into the lens
    return 1.0 if inside.any() else float((gap < radii[:, None]).any(0).mean())


@functools.cache
def _around(name: str, handle: str) -> np.ndarray:
    scene: Any = scenes.scene(name)
    center = _forward(scene, scene.fresh()).geom(handle).xpos
    return center + np.random.default_rng(1).uniform(-0.15, 0.15, (60, 3))


@functools.cache
def _frames(robot: Any) -> Any:
    import jax

    spheres = panda_spheres()
    return jax.jit(spheres.points(robot)), np.asarray(spheres.radii)


def _arm(scene: Any, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    points, radii = _frames(scene.robot)
    return np.asarray(points(q.astype(np.float32))), radii
