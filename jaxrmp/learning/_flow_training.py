"""Trains a flow so that its rays are the demonstrated paths."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import TrainingError
from .._pytree import single
from ..xla import quickly
from ._arc_length import resample_by_arc_length
from ._configuration import FlowSettings
from ._flow import Flow, initial_flow
from ._optax import import_optax

_SAMPLES = 200  # of a path, evenly in its arc length
_EVERY = 25  # one of so many is compared at an update
_JUDGED = 8  # one of so many tells in the end how much the flow stretches space
_UPDATES_A_CALL = 100
_PROBES = 16  # places near and as many far at an update at which the flow is kept from stretching and turning space
_LEAST_STRETCH, _MOST_STRETCH = 0.02, 150.0  # of space by a flow, on the demonstrations
_HUBER, _HUBER_TIMED = 0.1, 0.3  # error, over the flow's length, from where on it counts linearly
_UNSHOWN = 0.5  # what a path counts that nobody showed


class FlowFit(NamedTuple):
    """A trained `flow`; the `losses` [updates]; `stretch`, the least and the largest singular value of its Jacobian on
    the demonstrations; and the time that it took, `compilation_seconds` and `loop_seconds`."""

    flow: Flow
    losses: np.ndarray
    stretch: tuple[float, float]
    compilation_seconds: float
    loop_seconds: float


class Timing(NamedTuple):
    """The `radii`, N arrays [T], that an attractor of this `taper` has at the times of paths' points."""

    radii: Sequence[np.ndarray]
    taper: float


class _Paths(NamedTuple):
    """Paths `x` [N, S, m], `left` [N, S] of their length, or the radius at their times, with the attractor's `taper`,
    which else is 0; points `near` [M, m] them and `far` [F, m], whose `weights` [F] say how far."""

    x: jax.Array
    left: jax.Array
    taper: jax.Array
    near: jax.Array
    far: jax.Array
    weights: jax.Array


class _Draws(NamedTuple):
    """What is random in an update: a later start of each path [N]; the two paths [X] that are mixed, and in what shares
    [X]; paths [D] whose start is displaced, and by what [D, m]; where samples begin [P], a share of their distance;
    near and far points, and directions there [B, ...]."""

    start: np.ndarray
    first: np.ndarray
    second: np.ndarray
    share: np.ndarray
    displaced: np.ndarray
    aside: np.ndarray
    phase: np.ndarray
    near: np.ndarray
    shift: np.ndarray
    far: np.ndarray
    direction: np.ndarray


def train_flow(
    paths: Sequence[np.ndarray],
    far: np.ndarray,
    settings: FlowSettings | None = None,
    seed: int = 0,
    progress: Callable[[int, float], None] | None = None,
    timing: Timing | None = None,
) -> FlowFit:
    """Find the flow behind which each of `paths` is a straight line to the origin, as long as the path is.

    With an attractor behind a flow, motion from rest at x_0 is `phi^-1(r phi(x_0) / |phi(x_0)|)` for r from
    `|phi(x_0)|` down to 0: known without a rollout. These rays are compared with the paths, from their beginning and
    from further on, with r the length that is left; beside that, the flow is kept from stretching space near the
    paths, from turning it far from them, and follows what nobody showed, for starts beside the paths': mixtures of two
    paths, and paths whose start is displaced, which come back to what they were as the square of the length left.

    With `timing` r is the radius that the attractor has at each point's time, so that it is there then. Errors along
    the motion then count more, not less, but on paths of which nobody showed how fast they are, not at all.

    **Arguments**: `paths`, N arrays [T, m] that end at the origin, m in units of length; `far` [F, m], places where
    nothing is known and the flow is to be near the identity; `settings`; `seed`, of all that is random; `progress`,
    called with updates done and mean loss; `timing`, of the paths, which are then to be dense, even in time.
    **Returns** a `FlowFit`.
    **Raises** `TrainingError` if the loss is not finite.

    Our loss; the idea is Rana et al., Euclideanizing Flows (2020), where rollouts are compared.
    """
    settings = settings or FlowSettings()
    data = _paths(paths, far, timing)
    N, _, m = data.x.shape
    flow = initial_flow(seed, m, settings.couplings, settings.hidden, float(np.abs(data.x).max()) / 4)
    draws = _draws(np.random.default_rng([seed, 1]), settings, N, data)
    networks = _networks(flow)
    a_call = math.gcd(settings.updates, _UPDATES_A_CALL)
    calls = [jax.tree.map(lambda d, i=i: d[i : i + a_call], draws) for i in range(0, settings.updates, a_call)]
    carry, losses = (networks, _optimizer(settings).init(networks)), []
    clock = time.perf_counter()
    kind = {"settings": settings, "timed": timing is not None}
    run = _updates.lower(carry, calls[0], flow, data, **kind).compile()  # once for data of the same shapes
    compilation_seconds, clock = time.perf_counter() - clock, time.perf_counter()
    for i, drawn in enumerate(calls):
        carry, values = run(carry, drawn, flow, data)
        losses.append(np.asarray(values))
        if not np.isfinite(losses[-1]).all():
            raise TrainingError(
                f"the flow's loss is not finite after {(i + 1) * a_call} updates (learning rate "
                f"{settings.learning_rate}). Lower flow.learning_rate."
            )
        if progress is not None:
            progress((i + 1) * a_call, float(losses[-1].mean()))
    trained = _with(flow, carry[0])
    loop_seconds = time.perf_counter() - clock
    singular = stretches(trained, np.asarray(data.x)[:, ::_JUDGED].reshape(-1, m))
    ends = float(singular.min()), float(singular.max())
    return FlowFit(trained, np.concatenate(losses), ends, compilation_seconds, loop_seconds)


def stretches(flow: Flow, x: np.ndarray) -> np.ndarray:
    """Singular values [N, m] of the Jacobian of `flow` at points `x` [N, m]: how much it stretches space there."""
    return np.linalg.svd(np.asarray(_slopes(flow, jnp.asarray(x, jnp.float32)), float), compute_uv=False)


@quickly
def _slopes(flow: Flow, x: jax.Array) -> jax.Array:
    return jax.vmap(lambda x: flow.pushforward(x, jnp.zeros_like(x)).J)(x)


def check_stretch(fit: FlowFit) -> None:
    """**Raises** `TrainingError` for a flow that rollouts could not follow."""
    least, largest = fit.stretch
    if not (least >= _LEAST_STRETCH and largest <= _MOST_STRETCH):
        raise TrainingError(
            f"the flow stretches space by {least:.2g} to {largest:.2g} on the demonstrations, allowed {_LEAST_STRETCH} "
            f"to {_MOST_STRETCH}. Lower flow.learning_rate or raise flow.conditioning."
        )


@jax.jit
def rays(flow: Flow, starts: jax.Array, shares: jax.Array) -> jax.Array:
    """Where an attractor behind `flow` leads from rest at `starts` [N, m], `shares` [T] of the way left: [N, T, m]."""
    y = jax.vmap(flow)(starts)
    return jax.vmap(lambda y: jax.vmap(lambda share: flow.inverse(share * y))(shares))(y)


def _paths(paths: Sequence[np.ndarray], far: np.ndarray, timing: Timing | None) -> _Paths:
    if timing is None:
        x = np.stack([resample_by_arc_length(np.asarray(path, float), _SAMPLES) for path in paths])
        left, taper = np.asarray(_left(jnp.asarray(x))), 0.0
    else:
        columns = [np.column_stack(pair) for pair in zip(paths, timing.radii, strict=True)]
        x, left = np.split(np.stack([_even_in_both(both) for both in columns]), [-1], axis=-1)
        left, taper = left[..., 0], timing.taper
    near = x[:, ::4].reshape(-1, x.shape[-1])
    far = np.asarray(far, float).reshape(-1, x.shape[-1])
    distance = np.array([np.linalg.norm(near - point, axis=1).min() for point in far])
    weights = 1 - np.exp(-(distance**2) / (2 * 0.1**2))
    return jax.tree.map(jnp.asarray, single(_Paths(x, left, np.asarray(taper), near, far, weights)))


def _even_in_both(timed: np.ndarray) -> np.ndarray:
    """Of a path even in time with its radius, [T, m + 1], samples even in the mean of its time and its length."""
    length = np.append(0.0, np.linalg.norm(np.diff(timed[:, :-1], axis=0), axis=1).cumsum())
    gone = length / length[-1] + np.linspace(0, 1, len(timed))
    at = np.linspace(0, 2, _SAMPLES)
    return np.stack([np.interp(at, gone, column) for column in timed.T], axis=1)


def _left(x: jax.Array) -> jax.Array:
    """The length left [..., S] of paths [..., S, m] at each of their points."""
    steps = jnp.sqrt(jnp.sum(jnp.diff(x, axis=-2) ** 2, -1) + 1e-18)
    left = jnp.cumsum(steps[..., ::-1], -1)[..., ::-1]
    return jnp.concatenate([left, jnp.zeros_like(left[..., :1])], -1)


def _draws(rng: np.random.Generator, settings: FlowSettings, N: int, data: _Paths) -> _Draws:
    m, updates, displaced = data.x.shape[-1], settings.updates, settings.displaced
    mixtures = settings.mixtures if N > 1 else 0
    first = rng.integers(0, N, (updates, mixtures))
    direction = rng.normal(size=(updates, 2, _PROBES, m))
    return _Draws(
        start=rng.integers(0, 3 * _SAMPLES // 4, (updates, N)),
        first=first,
        second=(first + rng.integers(1, max(N, 2), (updates, mixtures))) % N,
        share=rng.uniform(-0.25, 0.5, (updates, mixtures)).astype(np.float32),
        displaced=rng.integers(0, N, (updates, displaced)),
        aside=rng.normal(0, settings.displacement, (updates, displaced, m)).astype(np.float32),
        phase=rng.uniform(size=(updates, 2 * N + mixtures + displaced)).astype(np.float32),
        near=rng.integers(0, len(data.near), (updates, _PROBES)),
        shift=rng.normal(0, 0.05 / np.sqrt(3), (updates, _PROBES, m)).astype(np.float32),
        far=rng.integers(0, max(len(data.far), 1), (updates, _PROBES)),
        direction=(direction / np.linalg.norm(direction, axis=-1, keepdims=True)).astype(np.float32),
    )


def _loss(flow: Flow, data: _Paths, drawn: _Draws, settings: FlowSettings, timed: bool) -> jax.Array:
    mixed = data.x[drawn.first] + drawn.share[:, None, None] * (data.x[drawn.second] - data.x[drawn.first])
    fades = (data.left[drawn.displaced] / data.left[drawn.displaced, :1]) ** 2
    unshown = jnp.concatenate([mixed, data.x[drawn.displaced] + fades[..., None] * drawn.aside[:, None]])
    if timed:
        mixed_left = data.left[drawn.first] + drawn.share[:, None] * (data.left[drawn.second] - data.left[drawn.first])
        unshown_left = jnp.concatenate([mixed_left, data.left[drawn.displaced]])
    else:
        unshown_left = _left(unshown)
    x, left = jnp.concatenate([data.x, data.x, unshown]), jnp.concatenate([data.left, data.left, unshown_left])
    N, X = len(data.x), len(unshown)
    start = jnp.concatenate([jnp.zeros(N, int), drawn.start, jnp.zeros(X, int)])
    steps = (jnp.arange(_SAMPLES // _EVERY) + drawn.phase[:, None]) / (_SAMPLES // _EVERY)
    at = start[:, None] + (steps * (_SAMPLES - 1 - start[:, None])).astype(int)
    rows = jnp.arange(len(x))
    begin, length = x[rows, start], left[rows, start]
    wanted = x[rows[:, None], at]
    along = x[rows[:, None], jnp.minimum(at + 1, _SAMPLES - 1)] - x[rows[:, None], jnp.maximum(at - 1, 0)]
    along = along / jnp.sqrt(jnp.sum(along**2, -1, keepdims=True) + 1e-18)
    y = jax.vmap(flow)(begin)
    radius = jnp.sqrt(jnp.sum(y**2, -1) + 1e-18)
    if timed:
        share = _later(left[rows[:, None], at], (radius - length)[:, None], data.taper) / radius[:, None]
    else:
        share = left[rows[:, None], at] / length[:, None]
    error = (jax.vmap(jax.vmap(flow.inverse))(share[..., None] * y[:, None]) - wanted) / flow.length
    late = jnp.sum(error * along, -1, keepdims=True) * along
    shown = jnp.arange(len(x)) < 2 * N
    if timed:  # nobody showed when to be where on the others
        timely = shown
        error = error + jnp.where(timely[:, None, None], 1.0, -1.0) * late
        huber = _HUBER_TIMED
    else:
        error = error - 0.5 * late  # when it is there matters half
        timely, huber = jnp.ones(len(x)), _HUBER
    counts = jnp.where(shown, 1.0, _UNSHOWN)[:, None]
    fit = jnp.mean(counts * (jnp.sqrt(huber**2 + jnp.sum(error**2, -1)) - huber)) * huber
    reach = jnp.mean(timely * ((radius - length) / flow.length) ** 2)
    probes = data.near[drawn.near] + drawn.shift
    if len(data.far):  # in one derivative with those that are near
        probes = jnp.concatenate([probes, data.far[drawn.far]])
    directions = drawn.direction.reshape(-1, x.shape[-1])[: len(probes)]
    moved = jax.vmap(lambda x, u: jax.jvp(flow, (x,), (u,))[1])(probes, directions)
    near, turned = moved[: len(drawn.near)], (moved - directions)[len(drawn.near) :]
    conditioning = jnp.mean(jnp.log(jnp.sqrt(jnp.sum(near**2, -1)) + 1e-9) ** 2)
    loss = 100 * fit + 10 * reach + settings.conditioning * conditioning
    if not len(data.far):
        return loss
    identity = jnp.mean(data.weights[drawn.far] * jnp.log1p(jnp.sum(turned**2, -1)))
    return loss + settings.identity * x.shape[-1] * identity


def _later(radius: jax.Array, behind: jax.Array, taper: jax.Array) -> jax.Array:
    """The radius of an attractor at the time when it were `radius`, had it not begun `behind` farther away, beyond the
    taper: `sinh(r / taper)` falls exponentially."""
    z = radius / taper
    log_sinh = z + jnp.log(-jnp.expm1(-2 * jnp.maximum(z, 1e-6))) - jnp.log(2.0) + behind / taper
    few = jnp.minimum(log_sinh, 10.0)
    return taper * jnp.where(log_sinh > 10, log_sinh + jnp.log(2.0), jnp.arcsinh(jnp.exp(few)))


@partial(jax.jit, static_argnames=("settings", "timed"))
def _updates(carry, draws: _Draws, flow: Flow, data: _Paths, *, settings: FlowSettings, timed: bool):
    """Some updates, one for each of `draws`; also returns their losses."""
    optimizer = _optimizer(settings)

    def update(carry, drawn):
        networks, state = carry
        loss, slope = jax.value_and_grad(lambda n: _loss(_with(flow, n), data, drawn, settings, timed))(networks)
        steps, state = optimizer.update(slope, state, networks)
        return (import_optax().apply_updates(networks, steps), state), loss

    return jax.lax.scan(update, carry, draws)


def _optimizer(settings: FlowSettings) -> Any:
    optax = import_optax()
    warm = min(50, settings.updates // 2)
    schedule = optax.warmup_cosine_decay_schedule(0.0, settings.learning_rate, warm, settings.updates)
    return optax.chain(optax.clip_by_global_norm(1.0), optax.adam(schedule))


def _networks(flow: Flow) -> dict[str, jax.Array]:
    layers = flow.couplings
    return {name: value for name, value in vars(layers).items() if name.startswith(("weights", "biases"))}


@jax.jit
def _with(flow: Flow, networks: dict[str, jax.Array]) -> Flow:
    return replace(flow, couplings=replace(flow.couplings, **networks)).centred()
