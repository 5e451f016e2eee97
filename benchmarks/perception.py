"""An articulated object tracked in depth images: how exactly, how reliably, how soon it is found again, how fast."""

import time
from typing import Any

import jax
import numpy as np

from jaxrmp._rotations import pose, rotation_of_vector
from jaxrmp.kinematics import forward_kinematics
from jaxrmp.perception import KINECT, ObjectTrackerSettings, object_model, robot_spheres, start_estimate, track
from jaxrmp.world import panda_spheres

from . import _calibrated
from ._children import stay_on_one_core
from ._seen_scenes import RATE, crossing, sequence, watched

SETTINGS = ObjectTrackerSettings()
_ROUGH = 0.05, np.radians(15.0)  # of the first guess, m and rad
_SETTLED = 1.0  # s, from when on errors count


def rows(seconds: float = 60.0, minutes: int = 10, finds: int = 10, calibrations: int = 5) -> list[dict[str, Any]]:
    """One minute of each; the door for ten at 1 m and ten at 2 m, and ten times hidden for two seconds and moved; and
    cameras found by the robot that they see."""
    stay_on_one_core()
    found = []
    for name, distance in (("door", 1.0), ("door", 2.0)):
        found.append(_row(name, distance, [_follow(name, distance, seed, seconds) for seed in range(minutes)]))
    for distance in (1.0, 2.0):
        found.append(_row("drawer pushed shut", distance, [_follow("drawer", distance, 0, seconds, shut=True)]))
    for distance in (1.0, 2.0):
        again = [_find_again("door", distance, seed) for seed in range(finds)]
        times = [t for t, _ in again]
        found.append(
            {
                "name": f"door hidden for 2 s, moved by 10 cm and 15 degrees meanwhile, at {distance:g} m",
                "runs": finds,
                "found_again": sum(np.isfinite(times)),
                "found_again_s": max(times),
                "ms_searching": float(np.median([ms for _, ms in again])),
            }
        )
    return found + _calibrated.rows(calibrations)


def _row(name: str, distance: float, runs: list[dict[str, Any]]) -> dict[str, Any]:
    unit, factor = ("degrees", np.degrees(1.0)) if name == "door" else ("mm", 1000.0)
    joint, handle, lost = (np.concatenate([run[key] for run in runs]) for key in ("joint", "handle", "lost"))
    return {
        "name": f"{name}, camera at {distance:g} m, arm crossing",
        "minutes": round(sum(run["seconds"] for run in runs) / 60, 2),
        "hidden_%": 100 * crossing(name.split()[0], distance)[2],
        f"joint_rms_{unit}": factor * _rms(joint),
        f"joint_worst_{unit}": factor * float(np.abs(joint).max()),
        "handle_rms_mm": 1000 * _rms(np.linalg.norm(handle, axis=1)),
        "handle_worst_mm": 1000 * float(np.linalg.norm(handle, axis=1).max()),
        "worst_minute_rms_mm": 1000 * max(_rms(np.linalg.norm(run["handle"], axis=1)) for run in runs),
        "frames_lost": int(lost.sum()),
        "found_first_s": max(run["first"] for run in runs),
        "ms": float(np.median(np.concatenate([run["ms"] for run in runs]))),
        "ms_99%": float(np.percentile(np.concatenate([run["ms"] for run in runs]), 99)),
    }


def _follow(name: str, distance: float, seed: int, seconds: float, shut: bool = False) -> dict[str, Any]:
    at = watched(name, distance)
    step, handle_of, estimate = _tracker(name, distance, seed)
    joint, handle, lost, ms, first = [], [], [], [], np.inf
    for seen in sequence(at, seed, seconds, shut=shut, distance=distance):
        start = time.perf_counter()
        estimate = jax.block_until_ready(step(estimate, seen.depth, seen.q.astype(np.float32)))
        ms.append(1000 * (time.perf_counter() - start))
        if not estimate.lost and first == np.inf:
            first = seen.time
        if seen.time >= _SETTLED:
            joint.append(float(estimate.q[0]) - seen.joint)
            handle.append(handle_of(estimate) - seen.handle)
            lost.append(bool(estimate.lost))
    found = {"joint": np.array(joint), "handle": np.array(handle), "lost": np.array(lost)}
    return {**found, "ms": np.array(ms[30:]), "first": first, "seconds": seconds}


def _find_again(name: str, distance: float, seed: int) -> tuple[float, float]:
    """Seconds until it is found where it is, to 2 cm, after it was hidden and moved; and ms a frame of the search."""
    at, rng = watched(name, distance), np.random.default_rng([8, seed])
    T = _other(np.array(at.scene.T_world_object), rng, 0.1, np.radians(15.0), upright=True)
    step, handle_of, estimate = _tracker(name, distance, seed)
    ms = []
    for seen in sequence(at, seed, 6.0, moved=(3.0, T), hidden=(2.0, 4.0), distance=distance):
        start = time.perf_counter()
        estimate = jax.block_until_ready(step(estimate, seen.depth, seen.q.astype(np.float32)))
        ms += [1000 * (time.perf_counter() - start)] if estimate.seen == 0 else []
        right = not estimate.lost and np.linalg.norm(handle_of(estimate) - seen.handle) < 0.02
        if seen.time >= 4.0 and right:
            return seen.time - 4.0 + 1 / RATE, float(np.median(ms))
    return np.inf, float(np.median(ms))


_made: dict[tuple, Any] = {}


def _tracker(name: str, distance: float, seed: int) -> tuple[Any, Any, Any]:
    """A compiled step, where an estimate has the handle, and an estimate from a rough guess."""
    at, rng = watched(name, distance), np.random.default_rng([9, seed])
    scene = at.scene
    if (name, distance) not in _made:
        model, spheres = object_model(scene.model, at.body), panda_spheres()
        geom = scene.model.geom(at.handle)
        body = scene.model.body(int(geom.bodyid[0])).name

        def step(estimate, depth, q):
            centers, radii = robot_spheres(scene.robot, spheres, q)
            return track(model, SETTINGS, estimate, depth, at.camera, centers, radii, KINECT)

        link = jax.jit(lambda q: forward_kinematics(model.robot, q, body))
        _made[name, distance] = model, jax.jit(step), link, np.append(geom.pos, 1.0)
    model, step, link, offset = _made[name, distance]

    def handle_of(estimate):
        return (np.asarray(estimate.T_world_object) @ np.asarray(link(estimate.q)) @ offset)[:3]

    first = next(sequence(at, seed, 1 / RATE, distance=distance))
    T = _other(np.array(scene.T_world_object), rng, *_ROUGH)
    q = np.array([first.joint + rng.choice([-1, 1]) * (_ROUGH[1] if name == "door" else _ROUGH[0])])
    return step, handle_of, start_estimate(model, SETTINGS, T, q)


def _other(T: np.ndarray, rng: np.random.Generator, far: float, turned: float, upright: bool = False) -> np.ndarray:
    """A pose `far`, m, from `T` in some direction and `turned`, rad, about some axis, or the vertical."""
    way, axis = rng.normal(size=3), rng.normal(size=3) * ([0, 0, 1] if upright else 1)
    position = T[:3, 3] + far * way / np.linalg.norm(way)
    return pose(position, rotation_of_vector(turned * axis / np.linalg.norm(axis)) @ T[:3, :3])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
