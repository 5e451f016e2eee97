"""Where a camera is, by the robot that it sees: Gauss-Newton over the camera's pose, for all images together."""

import dataclasses
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import CalibrationError, ShapeError
from .._linalg import cholesky, matmul, solve_lower, solve_lower_transposed
from .._rotations import rotation_of_vector
from ._camera import Camera
from ._evidence import evidence
from ._noise import KINECT, DepthNoise
from ._object_model import ObjectModel
from ._rays import Rays, pixels_of_object, rays_at
from ._settings import ObjectTrackerSettings

_NONE = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
_AHEAD, _AHEAD_SIGMAS = 0.03, 4.0  # m and standard deviations, by which a pixel is nearer than what is behind it
_BEST = 3  # guesses that are refined, until the robot is seen in all images
_ROUNDS, _FINE = 2, 6  # sets of pixels for each gate, and of the last one


class Calibration(NamedTuple):
    """Where a camera is, and how sure that is.

    `T_world_camera` [4, 4], in the world of the robot's model; `covariance` [6, 6], of a displacement of the camera, m,
    and a turn about itself, rad, both in its own frame; `seen` [N], whether each image shows the robot there; `fits`,
    `through` [N], the points that belong to the robot, and the rays that go through where it should be, over the pixels
    looked at; `rms`, m, of the distances that fit.
    """

    T_world_camera: np.ndarray
    covariance: np.ndarray
    seen: np.ndarray
    fits: np.ndarray
    through: np.ndarray
    rms: float


class _Base(NamedTuple):
    """Where the robot's world is, seen by the camera, `R` [3, 3], `t` [3], m."""

    R: jax.Array
    t: jax.Array


def calibrate_camera(
    model: ObjectModel,
    settings: ObjectTrackerSettings,
    depths: Any,
    q: Any,
    camera: Camera,
    *,
    guesses: int = 32,
    noise: DepthNoise = KINECT,
    tightest: tuple[float, float] = (0.01, 0.02),
) -> Calibration:
    """The pose of a camera that stands still, from N depth images of a robot in N postures.

    From a rough guess, within some 10 cm and 20 degrees: guesses round it are improved by the points that are nearer
    than what is behind them in other images, which are the robot's, and the best of them by all pixels round where it
    should be. The postures should differ, and show the robot from its base to its hand. Takes some seconds.

    **Arguments**: `model`, the robot, by `robot_object`; `settings`, of which the measuring counts, and `spread`,
    `search_points`, `search_gates` and `seed` of the search; `depths` [N, height, width], m; `q` [N, n], the robot's
    joints at each, rad or m; `camera`, its focal lengths and the guess of its pose in the robot's world; `guesses`, how
    many are compared; `noise`, the camera's; `tightest`, m and rad: a standard deviation in some direction above it is
    no calibration.
    **Raises** `ShapeError`; `CalibrationError` if fewer than two thirds of the images show the robot where it would
    have to be, or the postures do not say where the camera is to `tightest`.
    """
    depths, q = np.asarray(depths), np.asarray(q, float)
    n = model.num_joints
    if depths.ndim != 3 or depths.shape[1:] != (camera.height, camera.width) or not len(depths):
        raise ShapeError(f"depths has shape {depths.shape}, expected [N, {camera.height}, {camera.width}].")
    if q.shape != (len(depths), n):
        raise ShapeError(
            f"q has shape {q.shape}, expected ({len(depths)}, {n}): a posture of the robot for each image."
        )
    if not np.isfinite(q).all():
        raise ShapeError("q holds what is not finite.")
    dtype = jnp.result_type(float)
    here = dataclasses.replace(camera, T_world_camera=np.eye(4))
    depths, q = jnp.asarray(depths, dtype), jnp.asarray(q, dtype)
    T = np.linalg.inv(np.asarray(camera.T_world_camera, float))
    rng = np.random.default_rng(settings.seed)

    found = None
    for base in _searched(model, settings, here, noise, depths, q, T, guesses, rng):
        one = _refined(model, settings, here, noise, depths, q, base)
        found = one if found is None or one.score > found.score else found
        if _seen(settings, found).all():
            break
    assert found is not None
    return _judged(model, settings, found, tightest)


class _Refined(NamedTuple):
    base: _Base
    information: np.ndarray  # [6, 6]
    fits: np.ndarray  # [N]
    through: np.ndarray
    rms: float

    @property
    def score(self) -> float:
        return float(np.sqrt(self.fits.sum()) - 2 * np.sqrt(self.through.sum()))


def _weighed(
    model: ObjectModel,
    settings: ObjectTrackerSettings,
    camera: Camera,
    noise: DepthNoise,
    rays: Rays,
    base: _Base,
    q: jax.Array,
    gate: jax.Array,
    outlines: bool = True,
) -> tuple[jax.Array, ...]:
    """Normal equations [6, 6], [6] of all images together; of each its points that fit, and the rays that go through
    the robot, [N]; and the RMS, m."""

    def one(rays: Rays, q: jax.Array) -> tuple[jax.Array, ...]:
        seen = evidence(model, settings, camera, rays, *base, q, gate, noise, outlines)
        return seen.information[:6, :6], seen.gradient[:6], seen.fits.sum(), seen.through.sum(), seen.rms

    A, g, fits, through, rms = jax.vmap(one)(rays, q)
    weight = fits / jnp.maximum(fits.sum(), 1)
    return A.sum(0), g.sum(0), fits, through, jnp.sqrt((weight * rms * rms).sum())


def _searched(
    model: ObjectModel,
    settings: ObjectTrackerSettings,
    camera: Camera,
    noise: DepthNoise,
    depths: jax.Array,
    q: jax.Array,
    T: np.ndarray,
    guesses: int,
    rng: np.random.Generator,
) -> list[_Base]:
    """The best of some guesses round `T` [4, 4], each improved by the points that move from image to image."""
    uv = _moving_pixels(np.asarray(depths), settings.search_points, noise, rng)
    starts = [_Base(T[:3, :3], T[:3, 3])]
    for change in rng.normal(size=(guesses - 1, 6)) * np.repeat(settings.spread, 3):  # of the camera, about itself
        turn = rotation_of_vector(change[3:])
        starts.append(_Base(turn @ T[:3, :3], turn @ T[:3, 3] + change[:3]))
    stacked = _Base(*(jnp.asarray(np.stack(x), depths.dtype) for x in zip(*starts, strict=True)))
    bases, scores = _improved(model, settings, camera, noise, depths, q, jnp.asarray(uv), stacked)
    order = np.argsort(-np.where(np.isfinite(scores), scores, -np.inf))[:_BEST]
    return [jax.tree.map(lambda a, k=k: a[k], bases) for k in order]


@partial(jax.jit, static_argnames=("settings", "noise"))
def _improved(
    model: ObjectModel,
    settings: ObjectTrackerSettings,
    camera: Camera,
    noise: DepthNoise,
    depths: jax.Array,
    q: jax.Array,
    uv: jax.Array,
    bases: _Base,
) -> tuple[_Base, jax.Array]:
    """Each of some `bases` after some steps by the first half of pixels `uv` [N, S, 2], and how well it fits all."""
    rays = jax.vmap(lambda depth, uv: rays_at(depth, camera, uv, jnp.ones(len(uv), bool), *_NONE, 0.0))(depths, uv)
    moving = jax.tree.map(lambda a: a[:, : uv.shape[1] // 2], rays)

    def improve(base: _Base) -> tuple[_Base, jax.Array]:
        def step(base, gate):
            A, g, *_ = _weighed(model, settings, camera, noise, moving, base, q, gate, outlines=False)
            scale = jax.lax.rsqrt(jnp.diagonal(A) + 1)
            L = cholesky(A * scale[:, None] * scale + 1e-3 * jnp.eye(6, dtype=A.dtype))
            return _moved(model, base, -scale * solve_lower_transposed(L, solve_lower(L, scale * g))), None

        gates = jnp.repeat(jnp.asarray(settings.search_gates, depths.dtype), 2)
        base, _ = jax.lax.scan(step, base, gates)
        _, _, fits, through, _ = _weighed(model, settings, camera, noise, rays, base, q, gates[-1])
        return base, jnp.sum(jnp.sqrt(fits) - 2 * jnp.sqrt(through))

    return jax.lax.map(improve, bases)


def _moving_pixels(depths: np.ndarray, count: int, noise: DepthNoise, rng: np.random.Generator) -> np.ndarray:
    """Pixels [N, count, 2] of each image, half of them where it is nearer than others are: there something moves. The
    rest are anywhere, as all are where nothing moves."""
    known = (depths > 0) & (depths < noise.farthest)
    behind = np.where(known, depths, 0).max(0)
    sigma = noise.least + noise.grows * (behind - noise.nearest_sigma) ** 2 + 0.3 * noise.quantum * behind**2
    height, width = behind.shape
    found = []
    for depth, there in zip(depths, known, strict=True):
        moving = np.flatnonzero(there & (depth < behind - _AHEAD - _AHEAD_SIGMAS * sigma))
        half = count // 2 if len(moving) else 0
        chosen = rng.integers(height * width, size=count)
        chosen[:half] = rng.choice(moving, half) if half else 0
        found.append(np.stack([chosen % width, chosen // width], axis=1))
    return np.stack(found).astype(np.int32)


@partial(jax.jit, static_argnames=("settings", "noise"))
def _looked_at(
    model: ObjectModel,
    settings: ObjectTrackerSettings,
    camera: Camera,
    noise: DepthNoise,
    depths: jax.Array,
    q: jax.Array,
    base: _Base,
    gate: jax.Array,
    frame: jax.Array,
) -> tuple[jax.Array, ...]:
    """`_weighed`, by the pixels on and round where the robot would be seen, the set for this `frame`."""

    def look(depth: jax.Array, q: jax.Array) -> Rays:
        return rays_at(depth, camera, *pixels_of_object(model, camera, *base, q, frame), *_NONE, 0.0)

    return _weighed(model, settings, camera, noise, jax.vmap(look)(depths, q), base, q, gate)


def _refined(
    model: ObjectModel,
    settings: ObjectTrackerSettings,
    camera: Camera,
    noise: DepthNoise,
    depths: jax.Array,
    q: jax.Array,
    base: _Base,
) -> _Refined:
    """Improved by other pixels in each step; of the last ones the mean."""
    looked = sum(look.shape[1] for look in model.look)
    gates = [*np.repeat((0.05, *settings.gates[:-1]), _ROUNDS), *[settings.gates[-1]] * _FINE]
    A = np.zeros((6, 6))
    fits = through = np.zeros(len(q))
    rms = 0.0
    for frame, gate in enumerate(gates):
        A, g, fits, through, rms = jax.tree.map(
            lambda a: np.asarray(a, float), _looked_at(model, settings, camera, noise, depths, q, base, gate, frame)
        )
        # What the last sets of pixels say is taken together, so that the pose is the mean over all of them.
        change = -_solved(A, g)
        last = frame - (len(gates) - _FINE)
        base = _moved(model, base, jnp.asarray(change if last < 1 else change / (last + 1), depths.dtype))
    return _Refined(base, A, fits / looked, through / looked, float(rms))


def _solved(A: np.ndarray, g: np.ndarray) -> np.ndarray:
    """`A^-1 g`, nothing along directions of which A says next to nothing."""
    scale = 1 / np.sqrt(np.maximum(np.diag(A), 1e-12))
    values, vectors = np.linalg.eigh(A * scale[:, None] * scale)
    inverse = np.where(values > 1e-5, 1 / np.maximum(values, 1e-5), 0)
    return scale * (vectors @ (inverse * (vectors.T @ (scale * g))))


def _moved(model: ObjectModel, base: _Base, change: jax.Array) -> _Base:
    """Displaced by the first three of `change` [6], turned by the others about the model's middle, in its own frame."""
    middle = jnp.asarray(model.middle, change.dtype)
    turn = rotation_of_vector(change[3:])
    R = matmul(base.R, turn)
    R = matmul(R, 1.5 * jnp.eye(3, dtype=R.dtype) - 0.5 * matmul(R.T, R))
    return _Base(R, base.t + matmul(base.R, change[:3] + middle - matmul(turn, middle)))


def _seen(settings: ObjectTrackerSettings, one: _Refined) -> np.ndarray:
    return (one.fits > settings.enough) & (one.through < settings.contradicted * (one.fits + one.through))


def _judged(
    model: ObjectModel, settings: ObjectTrackerSettings, best: _Refined, tightest: tuple[float, float]
) -> Calibration:
    seen = _seen(settings, best)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.asarray(best.base.R, float), np.asarray(best.base.t, float)
    u, _, v = np.linalg.svd(T[:3, :3])
    T[:3, :3] = u @ v
    T = np.linalg.inv(T)
    # By a displacement of the camera in its own frame, of what is known by one of the robot's base in its.
    x, y, z = T[:3, 3] - np.asarray(model.middle, float)
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    J = np.zeros((6, 6))
    J[:3, :3], J[:3, 3:], J[3:, 3:] = -T[:3, :3].T, T[:3, :3].T @ across, -T[:3, :3].T
    back = np.linalg.inv(J)
    A = back.T @ (settings.trust * best.information) @ back
    scale = np.repeat(tightest, 3)
    values, vectors = np.linalg.eigh(A * scale[:, None] * scale)
    if seen.sum() < 2 / 3 * len(seen):
        shown = ", ".join(f"{f:.0%}" for f in best.fits)
        raise CalibrationError(
            f"the robot is not seen where it would have to be in {(~seen).sum()} of {len(seen)} images (of the "
            f"pixels round it, {shown} are its own): check the guess of the camera's pose, the joints, and whether the "
            "robot's geometry is what the camera sees."
        )
    if values[0] < 1:
        way = np.abs(vectors[:, 0])
        what = "turned" if way[3:].max() > way[:3].max() else "moved"
        raise CalibrationError(
            f"the postures do not say where the camera is: it could be {what} by more than {tightest[0]} m or "
            f"{np.degrees(tightest[1]):.1f} degrees. Show the robot in postures that differ more, with more of it seen."
        )
    covariance = scale[:, None] * (vectors / values) @ vectors.T * scale
    return Calibration(T, covariance, seen, best.fits, best.through, best.rms)
