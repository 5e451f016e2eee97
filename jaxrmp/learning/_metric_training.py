"""Fits the metrics of all subtasks at once to the directions of their demonstrations."""

import math
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, TrainingError, UnknownNameError
from ..leaves import natural_gradient_field
from ..xla import own_cores
from ._configuration import LOSSES
from ._metric_network import CholeskyFactor, blended, initial_cholesky_factor
from ._optax import import_optax
from ._support import Support

_UPDATES_A_CALL = 100  # in one compiled call, then progress is shown; fewer if that does not divide the updates


class MetricFit(NamedTuple):
    """Trained `factors`, stacked over K subtasks; the `losses` [updates, K]; and the time it took:
    `compilation_seconds` and `loop_seconds`."""

    factors: CholeskyFactor
    losses: np.ndarray
    compilation_seconds: float
    loop_seconds: float


def field_loss(L: jax.Array, slope: jax.Array, velocity: jax.Array, loss: str = "smooth_l1") -> jax.Array:
    """Mean regression loss between `-M^-1 slope` and `velocity`, `M = L L^T`, over N points of one subtask.

    **Arguments**: `L` [N, m, m]; `slope`, `velocity` [N, m].
    """
    error = natural_gradient_field(L, slope) - velocity
    if loss == "l2":
        return jnp.mean(jnp.sum(error**2, axis=-1))
    return jnp.mean(jnp.sum(import_optax().huber_loss(error, delta=0.1), axis=-1))


def train_metrics(
    x: jax.Array,
    slope: jax.Array,
    velocity: jax.Array,
    *,
    seed: int = 0,
    updates: int = 1000,
    learning_rate: float = 0.005,
    weight_decay: float = 3e-5,
    loss: str = "smooth_l1",
    hidden: tuple[int, ...] = (128, 64),
    activation: str = "relu",
    offset: float = 1e-3,
    length_scale: float = 1.0,
    support: Support | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> MetricFit:
    """Train the Cholesky factors of K subtasks so that `-M^-1 slope` reproduces `velocity` at all points.

    Full-batch Adam with a learning rate that falls to zero along a cosine, in a compiled loop that the subtasks share.
    They run at once: on a CPU, each on a core of its own.

    **Arguments**: `x` [K, N, m], positions, metres; `slope` [K, N, m], the potentials' gradients there; `velocity`
    [K, N, m], what the field should be; `seed`, of the first weights; `updates`, how many; `learning_rate`, the first;
    `weight_decay`, added to gradients; `loss`, `smooth_l1` or `l2`; `support`, K of them, stacked: where the networks
    count, by default everywhere; `progress`, called with updates done and mean loss; the rest as `CholeskyFactor`.
    **Returns** a `MetricFit`.
    **Raises** `TrainingError` if a loss is not finite; `UnknownNameError` for an unknown loss or activation.

    Rana et al. 2019, section 3.2.
    """
    optax = import_optax()
    UnknownNameError.check("loss", loss, LOSSES)
    if updates < 1:
        raise ConfigurationError(f"updates is {updates!r}, expected at least 1.")
    K = x.shape[0]
    keys = jax.random.split(jax.random.key(seed), K)

    def initial(key, support):
        return initial_cholesky_factor(key, x.shape[-1], hidden, activation, offset, length_scale, support)

    factors = jax.vmap(initial)(keys, support)
    shares = None
    if support is not None:  # they stay while weights change
        shares = jax.jit(jax.vmap(jax.vmap(lambda support, x: support(x), in_axes=(None, 0))))(support, x)
    # JAX's arrays: threads have not this one's precision, and would read others anew.
    stacked = jax.tree.map(jnp.asarray, _Problem(replace(factors, support=None), x, slope, velocity, shares))
    problems = [jax.tree.map(lambda a, k=k: jnp.asarray(np.asarray(a)[k]), stacked) for k in range(K)]
    schedule = optax.cosine_decay_schedule(learning_rate, updates)
    optimizer = optax.chain(
        optax.add_decayed_weights(weight_decay), optax.scale_by_adam(), optax.scale_by_learning_rate(schedule)
    )

    def loss_of(weights, problem):
        L = jax.vmap(replace(problem.network, weights=_transposed(weights)))(problem.x)
        if problem.shares is not None:
            L = jax.vmap(blended)(L, problem.shares)
        return field_loss(L, problem.slope, problem.velocity, loss)

    def run(weights, state, problem):
        def update(carry, _):
            weights, state = carry
            value, gradient = jax.value_and_grad(loss_of)(weights, problem)
            steps, state = optimizer.update(gradient, state, weights)
            return (optax.apply_updates(weights, steps), state), value

        return jax.lax.scan(update, (weights, state), length=a_call)

    a_call = math.gcd(updates, _UPDATES_A_CALL)
    # Transposed, a layer's gradient is a product that XLA:CPU does half again as fast.
    first = [_transposed(problem.network.weights) for problem in problems]
    carries = [(weights, optimizer.init(weights)) for weights in first]
    clock = time.perf_counter()
    compiled = jax.jit(run).lower(*carries[0], problems[0]).compile()
    compilation_seconds, clock = time.perf_counter() - clock, time.perf_counter()

    def advance(k):
        carries[k], values = compiled(*carries[k], problems[k])
        return np.asarray(values)

    losses: list[list[np.ndarray]] = [[] for _ in range(K)]
    done = 0
    for k, values in _side_by_side(advance, K, updates // a_call):
        losses[k].append(values)
        if not np.isfinite(values).all():
            raise TrainingError(
                f"the metric's loss is not finite after {len(losses[k]) * a_call} updates (learning rate "
                f"{learning_rate}). Lower the learning rate, or raise the diagonal offset."
            )
        if min(map(len, losses)) > done:
            done += 1
            if progress is not None:
                progress(done * a_call, float(np.mean([found[done - 1][-1] for found in losses])))
    loop_seconds = time.perf_counter() - clock
    weights = jax.tree.map(lambda *parts: jnp.stack(parts), *(_transposed(weights) for weights, _ in carries))
    every = np.stack([np.concatenate(found) for found in losses], axis=1)
    return MetricFit(replace(factors, weights=weights), every, compilation_seconds, loop_seconds)


def _transposed(weights: Any) -> Any:
    return jax.tree.map(jnp.transpose, weights)


class _Problem(NamedTuple):
    """What one subtask is trained on; `shares` [N] of the network in its factor, None for all."""

    network: CholeskyFactor
    x: jax.Array
    slope: jax.Array
    velocity: jax.Array
    shares: jax.Array | None


def _side_by_side(advance: Callable[[int], np.ndarray], count: int, calls: int) -> Iterator[tuple[int, np.ndarray]]:
    """Call `advance(k)` so many times for each k below `count`, and different k at once: each k with what it returned.

    A matrix product of this size gains little from a second core; another subtask's gains all of it.
    """
    left = [calls] * count
    with ThreadPoolExecutor(min(count, own_cores())) as pool:
        running = {pool.submit(advance, k): k for k in range(count)}
        try:
            while running:
                for future in sorted(wait(running, return_when=FIRST_COMPLETED).done, key=running.__getitem__):
                    k, values = running.pop(future), future.result()
                    left[k] -= 1
                    if left[k]:
                        running[pool.submit(advance, k)] = k
                    yield k, values
        finally:
            pool.shutdown(cancel_futures=True)
