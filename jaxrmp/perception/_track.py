"""Follow an articulated object from one depth image to the next: an extended Kalman filter whose update is
Gauss-Newton over the base's pose and the joints."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, ShapeError
from .._linalg import cholesky, matmul, solve_lower, solve_lower_transposed
from .._rotations import rotation_of_vector
from .._task_map import check_rigid
from ._camera import Camera
from ._evidence import Evidence, evidence
from ._noise import KINECT, DepthNoise
from ._object_model import ObjectModel
from ._rays import Rays, pixels_of_object, rays_at
from ._settings import ObjectTrackerSettings


class Place(NamedTuple):
    """Where an object's base is, `R` [3, 3] and `t` [3], m, and its joints, `q` [n]."""

    R: jax.Array
    t: jax.Array
    q: jax.Array


class Estimate(NamedTuple):
    """Where an object is, and how sure that is.

    `T_world_object` [4, 4], its base; `q`, `qd` [n], its joints, rad or m, and their speeds; `covariance`
    [6 + 2n, 6 + 2n], of a displacement of the base, m, a turn about `ObjectModel.middle`, rad, both in its frame, of
    q and of qd; `lost`, whether the last image did not show it; `seen`, in how many images in a row it was; `frame`,
    how many there were; `fits`, `through` [L], the points that belong to each link, and the rays that go through
    it, over how many pixels were looked at for it; `rms`, m, of the distances that fit; `guess`, where it might be,
    while it is looked for; `sure`, where it was when last seen in `confirm` images in a row, at first where it was said
    to be: what is seen for a moment only, in the wrong place, does not lead the search away.
    While it is lost, the pose stays where it was seen last.
    """

    T_world_object: jax.Array
    q: jax.Array
    qd: jax.Array
    covariance: jax.Array
    lost: jax.Array
    seen: jax.Array
    frame: jax.Array
    fits: jax.Array
    through: jax.Array
    rms: jax.Array
    guess: Place
    sure: Place


def start_estimate(model: ObjectModel, settings: ObjectTrackerSettings, T_world_object: Any, q: Any) -> Estimate:
    """An estimate before the first image, from a rough guess: within some 5 cm and 15 degrees.

    **Arguments**: `model`, the object; `settings`, the tracker's; `T_world_object` [4, 4], m; `q` [n], rad or m.
    **Raises** `ShapeError`, `RigidTransformError`, `ConfigurationError` for `q` that are not finite.
    """
    n, links = model.num_joints, len(model.links)
    if np.shape(q) != (n,):
        raise ShapeError(f"q has shape {np.shape(q)}, expected ({n},): one for each joint of {model.robot.name!r}.")
    if not np.isfinite(q).all():
        raise ConfigurationError(f"q is {q}, expected finite numbers.")
    if not settings.gates or not settings.search_gates:
        raise ConfigurationError("object_tracker.gates and search_gates need an entry each: one a step.")
    dtype = jnp.result_type(float)
    T = jnp.asarray(check_rigid(T_world_object), dtype)
    P = jnp.diag(_wide(settings, n, dtype))
    shares = jnp.zeros(links, dtype)
    zero, none = jnp.zeros((), dtype), jnp.zeros((), jnp.int32)
    q = jnp.asarray(q, dtype)
    guess = Place(T[:3, :3], T[:3, 3], q)
    return Estimate(T, q, jnp.zeros(n, dtype), P, jnp.array(True), none, none, shares, shares, zero, guess, guess)


def track(
    model: ObjectModel,
    settings: ObjectTrackerSettings,
    estimate: Estimate,
    depth: jax.Array,
    camera: Camera,
    centers: Any = (),
    radii: Any = (),
    noise: DepthNoise = KINECT,
) -> Estimate:
    """The estimate after one more image.

    Pure, of fixed size; to be compiled with `settings` and `noise` closed over, and mapped over any other argument.

    **Arguments**: `model`, the object; `estimate`, that of the image before, of `start_estimate` at first; `depth`
    [height, width], m, not positive or not finite where nothing was measured; `camera`, where it
    was; `centers` [K, 3], `radii` [K], spheres that hold the robot as it was then, in the world, m: what they hold is
    not looked at (`robot_spheres`).
    **Raises** `ShapeError` for an image of another size than the camera's.
    """
    if depth.shape != (camera.height, camera.width):
        raise ShapeError(f"depth has shape {depth.shape}, expected ({camera.height}, {camera.width}).")
    dtype, n = estimate.q.dtype, model.num_joints
    depth = depth.astype(dtype)
    last = Place(estimate.T_world_object[:3, :3], estimate.T_world_object[:3, 3], estimate.q)
    dt = 1 / settings.rate
    robot = jnp.reshape(jnp.asarray(centers, dtype), (-1, 3)), jnp.asarray(radii, dtype)

    def look(uv: jax.Array, wanted: jax.Array) -> Rays:
        return rays_at(depth, camera, uv, wanted, *robot, settings.robot_margin)

    def weigh(rays: Rays, place: Place, gate: jax.Array) -> Evidence:
        return evidence(model, settings, camera, rays, *place, gate, noise)

    F = jnp.eye(6 + 2 * n, dtype=dtype).at[6 : 6 + n, 6 + n :].set(dt * jnp.eye(n, dtype=dtype))
    P = matmul(matmul(F, estimate.covariance), F.T) + _process(settings, n, dtype)
    followed = last._replace(q=_within(model, last.q + dt * estimate.qd)), estimate.qd, P

    def found(_: None) -> tuple[Place, jax.Array, jax.Array, Place]:
        first = jax.tree.map(lambda a, b: jnp.where(estimate.lost, a, b), estimate.sure, followed[0])
        others = estimate.guess, estimate.sure
        place, better = _search(model, settings, first, *others, look, weigh, camera, estimate.frame)
        wide = jnp.asarray([0.02] * 3 + [0.1] * 3 + [0.2] * n + [1.0] * n, dtype)
        elsewhere = place, jnp.zeros(n, dtype), jnp.diag(wide * wide)
        return *jax.tree.map(lambda a, b: jnp.where(estimate.lost | better, a, b), elsewhere, followed), place

    looks = estimate.seen < settings.confirm
    place, qd, P, guess = jax.lax.cond(looks, found, lambda _: (*followed, estimate.guess), None)
    rays = look(*pixels_of_object(model, camera, place.R, place.t, place.q, estimate.frame))
    prior = _inverse(P)
    m = 6 + n
    moved = jnp.zeros(m + n, dtype)

    def step(carry, gate):
        place, moved = carry
        seen = weigh(rays, place, gate)
        A = prior.at[:m, :m].add(settings.trust * seen.information)
        b = matmul(prior, moved).at[:m].add(settings.trust * seen.gradient)
        change = -_solve(A, b)
        moved = moved + change
        return (_move(model, place, change[:m]), moved), None

    (place, moved), _ = jax.lax.scan(step, (place, moved), jnp.asarray(settings.gates, dtype))
    seen = weigh(rays, place, jnp.asarray(settings.gates[-1], dtype))
    covariance = _inverse(prior.at[:m, :m].add(settings.trust * seen.information))
    asked = jnp.asarray([look.shape[1] for look in model.look], dtype)
    fits, through = seen.fits / asked, seen.through / asked
    lost = ((fits < settings.enough) | (through > settings.contradicted * (fits + through))).any()
    lost = lost | ~jnp.isfinite(moved).all()
    T = jnp.asarray(jnp.eye(4), dtype).at[:3, :3].set(_orthonormal(place.R)).at[:3, 3].set(place.t)
    wide = jnp.diag(_wide(settings, n, dtype))
    count = jnp.where(lost, 0, estimate.seen + 1)
    sure = jax.tree.map(lambda a, b: jnp.where(count < settings.confirm, a, b), estimate.sure, place)
    return Estimate(
        jnp.where(lost, estimate.T_world_object, T),
        jnp.where(lost, estimate.q, place.q),
        jnp.where(lost, 0, qd + moved[m:]),
        jnp.where(lost, wide, covariance),
        lost,
        count,
        estimate.frame + 1,
        fits,
        through,
        seen.rms,
        guess,
        sure,
    )


def _search(
    model, settings, last: Place, guess: Place, around: Place, look, weigh, camera: Camera, frame: jax.Array
) -> tuple[Place, jax.Array]:
    """The best of some guesses, each improved, and whether it is clearly better than the first, which is `last`.

    The second is the best `guess` of the image before, the others lie round that and `around` in turn; what is far
    from `around` is less likely. Each looks at the pixels where it would be seen itself: pixels beside it, of a floor
    close below say, would pull it away.
    """
    dtype, n, R = last.t.dtype, model.num_joints, settings.guesses
    key = jax.random.fold_in(jax.random.key(settings.seed), frame)
    for_base, for_joints = jax.random.split(key)
    share = min(settings.search_points / sum(look.shape[1] for look in model.look), 1.0)
    spread = jnp.asarray([settings.spread[0]] * 3 + [settings.spread[1]] * 3, dtype)
    change = spread * jax.random.normal(for_base, (R, 6), dtype)
    low, high = (jnp.clip(jnp.asarray(b, dtype), -np.pi, np.pi) for b in (model.robot.lower, model.robot.upper))
    drawn = low + (high - low) * jax.random.uniform(for_joints, (R, n), dtype)
    which = jnp.arange(R)

    def choose(*places: jax.Array) -> jax.Array:
        return jnp.stack(places)[jnp.where(which == 0, 0, 1 + which % 2)]

    start = jax.tree.map(choose, last, around, guess)
    change = jnp.where((which < 2)[:, None], 0, jnp.concatenate([change, drawn - start.q], axis=1))
    guesses = jax.vmap(lambda p, c: _move(model, p, c))(start, change)
    damping = jnp.diag(jnp.concatenate([1 / spread**2, jnp.full(n, 4.0, dtype)]))

    def seen_at(place: Place, gate: jax.Array) -> Evidence:
        return weigh(look(*pixels_of_object(model, camera, *place, frame, share)), place, gate)

    def improve(place: Place) -> tuple[Place, jax.Array]:
        def step(place, gate):
            seen = seen_at(place, gate)
            change = -_solve(settings.trust * seen.information + damping, settings.trust * seen.gradient)
            return _move(model, place, change), None

        place, _ = jax.lax.scan(step, place, jnp.asarray(settings.search_gates, dtype))
        seen = seen_at(place, jnp.asarray(settings.search_gates[-1], dtype))
        score = jnp.sum(jnp.sqrt(seen.fits) - 2 * jnp.sqrt(seen.through))
        return place, score - _far(model, settings, place, around)

    places, scores = jax.vmap(improve)(guesses)
    scores = jnp.where(jnp.isfinite(scores), scores, -jnp.inf)
    best = jnp.argmax(scores)
    return jax.tree.map(lambda a: a[best], places), scores[best] > scores[0] + settings.better


def _far(model: ObjectModel, settings: ObjectTrackerSettings, place: Place, around: Place) -> jax.Array:
    """Half the squared distance of `place` from `around`, in twice the `spread` of guesses."""
    R, middle = place.R - around.R, jnp.asarray(model.middle, place.t.dtype)
    away = (matmul(R, middle) + place.t - around.t) / (2 * settings.spread[0])
    turned = R / (2**0.5 * 2 * settings.spread[1])  # the norm of a small turn's matrix is the root of two times it
    return 0.5 * (jnp.sum(away * away) + jnp.sum(turned * turned))


def _move(model: ObjectModel, place: Place, change: jax.Array) -> Place:
    """Displaced by the first three of `change` [6 + n], turned by the next about the middle, joints by the others."""
    middle = jnp.asarray(model.middle, change.dtype)
    turn = rotation_of_vector(change[3:6])
    t = place.t + matmul(place.R, change[:3] + middle - matmul(turn, middle))
    return Place(matmul(place.R, turn), t, _within(model, place.q + change[6:]))


def _within(model: ObjectModel, q: jax.Array) -> jax.Array:
    return jnp.clip(q, jnp.asarray(model.robot.lower, q.dtype), jnp.asarray(model.robot.upper, q.dtype))


def _process(settings: ObjectTrackerSettings, n: int, dtype) -> jax.Array:
    dt = 1 / settings.rate
    base = np.repeat(settings.drift, 3) ** 2 * dt
    Q = np.zeros((6 + 2 * n,) * 2)
    Q[:6, :6] = np.diag(base)
    for j in range(n):
        a, b = 6 + j, 6 + n + j
        Q[a, a], Q[a, b], Q[b, a], Q[b, b] = dt**3 / 3, dt**2 / 2, dt**2 / 2, dt
    Q[6:, 6:] *= settings.jerkiness**2
    return jnp.asarray(Q, dtype)


def _wide(settings: ObjectTrackerSettings, n: int, dtype) -> jax.Array:
    sigma = [settings.spread[0]] * 3 + [settings.spread[1]] * 3 + [0.5] * n + [1.0] * n
    return jnp.square(jnp.asarray(sigma, dtype))


def _solve(A: jax.Array, b: jax.Array) -> jax.Array:
    """`A^-1 b` of a symmetric positive definite A, whose rows are of very different sizes: scaled first."""
    scale = jax.lax.rsqrt(jnp.diagonal(A))
    L = cholesky(A * scale[:, None] * scale + 1e-6 * jnp.eye(len(b), dtype=b.dtype))
    return scale * solve_lower_transposed(L, solve_lower(L, scale * b))


def _inverse(A: jax.Array) -> jax.Array:
    columns = jax.vmap(lambda b: _solve(A, b))(jnp.eye(len(A), dtype=A.dtype))
    return 0.5 * (columns + columns.T)


def _orthonormal(R: jax.Array) -> jax.Array:
    """One step towards the nearest rotation: rounding is small from one image to the next."""
    return matmul(R, 1.5 * jnp.eye(3, dtype=R.dtype) - 0.5 * matmul(R.T, R))
