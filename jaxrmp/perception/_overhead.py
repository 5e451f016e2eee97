"""Where to put a camera over an object, so that an arm at work hides little of it."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, ShapeError
from .._ranges import require_number
from ..kinematics._body_poses import body_poses
from ._camera import Camera
from ._nearest import parts_at
from ._object_model import ObjectModel
from ._see_through import seen_through

_POINTS = 100  # of a link
_CLEAR = 0.05  # m before a point, within which it may be hidden by its own part
_LENS = 0.1  # m round the eye that the arm must keep out of


def looked_at(model: ObjectModel, poses: Any, q: Any) -> np.ndarray:
    """The middle [3], m, in the world, of what the object's joints move, or of all of it where they move nothing.

    **Arguments**: `model`, the object; `poses` [P, 4, 4], where its base may be; `q` [n], its joints.
    """
    points, moves = _points(model, poses, q)
    return points[:, moves if moves.any() else slice(None)].mean((0, 1))


def overhead_camera(
    model: ObjectModel,
    poses: Any,
    q: Any,
    centers: Any = None,
    radii: Any = (),
    *,
    distance: float = 1.0,
    elevation: float = float(np.radians(50.0)),
    width: int = 640,
    height: int = 480,
    fovy: float = 45.0,
    azimuths: int = 36,
) -> Camera:
    """A camera over an object that looks at what its joints move, from the side from which most of it is seen.

    Of cameras all round, the one that sees the greatest share of points on the object's links, each link alike: those
    in the picture that neither the arm hides on its way nor the object's own parts do. What else stands around is not
    known here.

    **Arguments**: `model`, the object; `poses` [P, 4, 4], where its base may be; `q` [n], its joints; `centers`
    [P, S, K, 3] and `radii` [K], m, spheres that hold the robot at S instants of its way with the object at each of the
    `poses`, none for no robot; `distance`, m, from the middle of what moves (`looked_at`), and `elevation`, rad, over
    it; `width`, `height`, pixels; `fovy`, degrees from top to bottom; `azimuths`, how many are compared.
    **Raises** `ShapeError`, `ConfigurationError` for a distance that is not positive or an elevation not below a right
    angle.
    """
    require_number("overhead_camera", "distance", distance)
    if not 0 <= elevation < np.pi / 2:
        raise ConfigurationError(f"elevation of overhead_camera is {elevation!r} rad, expected 0 to below pi / 2.")
    poses, radii = np.asarray(poses, float), np.asarray(radii, float)
    centers = np.zeros((len(poses), 1, 0, 3)) if centers is None else np.asarray(centers, float)
    if centers.ndim != 4 or len(centers) != len(poses) or centers.shape[2:] != (len(radii), 3):
        raise ShapeError(f"centers have shape {centers.shape}, expected ({len(poses)}, S, {len(radii)}, 3).")
    target = looked_at(model, poses, q)
    points, _ = _points(model, poses, q)
    turns = np.linspace(-np.pi, np.pi, azimuths, endpoint=False)
    up = np.full(azimuths, np.tan(elevation))
    ways = np.stack([np.cos(turns), np.sin(turns), up], axis=1) * np.cos(elevation)
    cameras = [Camera.looking(target + distance * way, target, width, height, fovy) for way in ways]
    apart = _in_front_of_itself(model, poses, q, points, np.array([_eye(camera) for camera in cameras]))
    seen = [_seen(camera, points, centers, radii, own) for camera, own in zip(cameras, apart, strict=True)]
    return cameras[int(np.argmax(seen))]


def _points(model: ObjectModel, poses: Any, q: Any) -> tuple[np.ndarray, np.ndarray]:
    """Points [P, N, 3] on and round the links, as many on each, in the world, and which of the N a joint moves."""
    poses, q = np.asarray(poses, float), np.asarray(q, float)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or not len(poses):
        raise ShapeError(f"poses have shape {poses.shape}, expected (P, 4, 4), P at least one.")
    if q.shape != (model.num_joints,):
        raise ShapeError(f"q has shape {q.shape}, expected ({model.num_joints},).")
    at, found, moves = body_poses(model.robot.model, q[None]), [], []
    for k, look in zip(model.links, model.look, strict=True):
        cloud = np.resize(np.asarray(look, float).reshape(-1, 3), (_POINTS, 3))
        found.append(cloud @ at[k][0, :3, :3].T + at[k][0, :3, 3])
        moves += [bool(model.robot.model.joints_above(k))] * _POINTS
    points = np.concatenate(found)
    return np.einsum("pij,nj->pni", poses[:, :3, :3], points) + poses[:, None, :3, 3], np.array(moves)


def _eye(camera: Camera) -> np.ndarray:
    return np.asarray(camera.T_world_camera, float)[:3, 3]


def _in_front_of_itself(model: ObjectModel, poses: np.ndarray, q: Any, points: np.ndarray, eyes: np.ndarray) -> Any:
    """Which points [A, P, N] no part of the object hides from each of the `eyes` [A, 3]."""
    parts = parts_at(model, jnp.asarray(q, jnp.result_type(float)))
    local = np.einsum("pij,pni->pnj", poses[:, :3, :3], points - poses[:, None, :3, 3])
    eyes_local = np.einsum("pij,api->apj", poses[:, :3, :3], eyes[:, None] - poses[None, :, :3, 3])

    def hidden(p, eye):
        before = 1 - _CLEAR / jnp.maximum(jnp.linalg.norm(p - eye, axis=1), 2 * _CLEAR)
        return seen_through(parts, (p[:, 0], p[:, 1], p[:, 2]), (eye[0], eye[1], eye[2]), before).distance < 0

    every = jax.vmap(jax.vmap(hidden), (None, 0))
    return ~np.asarray(jax.jit(every)(jnp.asarray(local, float), jnp.asarray(eyes_local, float)))


def _seen(camera: Camera, points: np.ndarray, centers: np.ndarray, radii: np.ndarray, own: np.ndarray) -> float:
    """The share of `points` [P, N, 3] that is seen past spheres at `centers` [P, S, K, 3], on the way as a whole."""
    T, eye = np.asarray(camera.T_world_camera, float), _eye(camera)
    inside = np.asarray(camera.pixel(jnp.asarray((points - eye) @ T[:3, :3], float))[1])
    way = points - eye
    square = (way * way).sum(-1)[:, None, None]
    slot = np.einsum("pskj,pnj->pskn", centers - eye, way) / square
    t = np.minimum(slot, 1)
    off = ((centers - eye) ** 2).sum(-1)[..., None] + (t * t - 2 * t * slot) * square
    met = (slot > 0) & (off < radii[:, None] ** 2)
    close = (((centers - eye) ** 2).sum(-1) < (radii + _LENS) ** 2).any(-1)
    free = ~met.any(2) & ~close[..., None]
    return float((free & (own & inside)[:, None]).mean())
