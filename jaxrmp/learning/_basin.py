"""Does descent on a potential end at the goal from everywhere? Measured, because the fit does not promise it."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np


class Basin(NamedTuple):
    """Outcome of a basin check.

    `starts`, how many; `share_reached`, the share that ended at the goal; `rest_points`, the other places where descent
    ended, each as (position [m], share of starts), most visited first.
    """

    starts: int
    share_reached: float
    rest_points: tuple[tuple[tuple[float, ...], float], ...]


@partial(jax.jit, static_argnames=("steps", "settling"))
def descend(potential: Callable, starts: jax.Array, step: jax.Array, steps: int, settling: int) -> jax.Array:
    """Where gradient descent with steps of fixed length ends, from each of `starts` [N, m].

    `steps` moves of length `step`, then `settling` moves that shrink by a tenth each, so that the end lies within the
    last step's length of a stationary point.
    """

    def move(x, length):
        slope = jax.vmap(jax.grad(potential))(x)
        norm = jnp.linalg.norm(slope, axis=-1, keepdims=True)
        return x - length * slope / jnp.maximum(norm, 1e-12), None

    lengths = step * jnp.concatenate([jnp.ones(steps), 0.9 ** jnp.arange(settling)])
    ends, _ = jax.lax.scan(move, starts, lengths.astype(starts.dtype))
    return ends


def check_basin(
    potential: Callable,
    lower: np.ndarray,
    upper: np.ndarray,
    *,
    starts: int = 2000,
    margin: float = 0.3,
    tolerance: float = 0.01,
    seed: int = 0,
) -> Basin:
    """Descend on `potential` from random starts in the box [lower - margin, upper + margin] and see where it ends.

    **Arguments**: `potential`, a callable pytree `x -> Phi` with its goal at the origin; `lower`, `upper` [m], metres,
    the box of the demonstrations; `starts`, how many; `margin`, metres; `tolerance`, metres: ends nearer than this to
    the origin count as the goal, ends nearer than this to each other as one; `seed`, of the starts.
    **Returns** a `Basin`.
    """
    lower, upper = np.asarray(lower, float) - margin, np.asarray(upper, float) + margin
    x = np.random.default_rng(seed).uniform(lower, upper, (starts, len(lower)))
    step = tolerance
    steps = int(np.ceil(1.5 * np.linalg.norm(upper - lower) / step / 50) * 50)  # in fifties, to compile seldom
    ends = np.asarray(descend(potential, jnp.asarray(x, jnp.float32), step, steps, 40))
    astray = ends[~(np.linalg.norm(ends, axis=-1) < tolerance)]
    groups = cluster(astray, 2 * tolerance)
    rest_points = tuple((tuple(float(v) for v in astray[g].mean(0)), len(g) / starts) for g in groups)
    return Basin(starts, 1 - len(astray) / starts, rest_points)


def cluster(points: np.ndarray, radius: float) -> list[np.ndarray]:
    """Members of each cluster of points [N, m], largest first: everything within `radius` of its first member."""
    left, found = np.arange(len(points)), []
    while len(left):
        near = ~(np.linalg.norm(points[left] - points[left[0]], axis=-1) >= radius)
        found.append(left[near])
        left = left[~near]
    return sorted(found, key=len, reverse=True)
