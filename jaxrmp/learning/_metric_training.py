"""Fits the metrics of all subtasks at once to the directions of their demonstrations. Only this module knows optax."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import ConfigurationError, MissingDependencyError, TrainingError, UnknownNameError
from ..leaves import natural_gradient_field
from ._configuration import LOSSES
from ._metric_network import CholeskyFactor, blended, initial_cholesky_factor
from ._support import Support

try:
    import optax
except ImportError as error:
    raise MissingDependencyError("optax", "learning") from error


_UPDATES_A_CALL = 100  # in one compiled call, then progress is shown; fewer if that does not divide the updates


class MetricFit(NamedTuple):
    """Trained factors, stacked over subtasks; the loss of every update, [updates, K]; and the time it took, s."""

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
    return jnp.mean(jnp.sum(optax.huber_loss(error, delta=0.1), axis=-1))


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

    Full-batch Adam with a learning rate that falls to zero along a cosine, all subtasks in one compiled loop.

    **Arguments**: `x` [K, N, m], positions, metres; `slope` [K, N, m], the potentials' gradients there; `velocity`
    [K, N, m], what the field should be; `support`, K of them, stacked: where the networks count,
    by default everywhere; `progress`, called with the updates done and the mean loss.
    **Returns** a `MetricFit`.
    **Raises** `TrainingError` if a loss is not finite; `UnknownNameError` for an unknown loss or activation.

    Rana et al. 2019, section 3.2.
    """
    if loss not in LOSSES:
        raise UnknownNameError("loss", loss, LOSSES)
    if updates < 1:
        raise ConfigurationError(f"updates is {updates!r}, expected at least 1.")
    keys = jax.random.split(jax.random.key(seed), x.shape[0])

    def initial(key, support):
        return initial_cholesky_factor(key, x.shape[-1], hidden, activation, offset, length_scale, support)

    factors = jax.vmap(initial)(keys, support)
    schedule = optax.cosine_decay_schedule(learning_rate, updates)
    optimizer = optax.chain(
        optax.add_decayed_weights(weight_decay), optax.scale_by_adam(), optax.scale_by_learning_rate(schedule)
    )

    over_points = jax.vmap(jax.vmap(lambda function, x: function(x), in_axes=(None, 0)))
    shares = None if support is None else over_points(support, x)  # they stay what they are while weights change

    def total(weights):
        networks = replace(factors, weights=weights, support=None)
        L = over_points(networks, x)
        L = L if shares is None else jax.vmap(jax.vmap(blended))(L, shares)
        losses = jax.vmap(partial(field_loss, loss=loss))(L, slope, velocity)
        return losses.sum(), losses  # subtasks share no weight, so the gradient of the sum trains each alone

    def run(weights, state):
        def update(carry, _):
            weights, state = carry
            gradient, losses = jax.grad(total, has_aux=True)(weights)
            steps, state = optimizer.update(gradient, state, weights)
            return (optax.apply_updates(weights, steps), state), losses

        return jax.lax.scan(update, (weights, state), length=a_call)

    a_call = math.gcd(updates, _UPDATES_A_CALL)
    carry = (factors.weights, optimizer.init(factors.weights))
    clock = time.perf_counter()
    compiled = jax.jit(run).lower(*carry).compile()
    compilation_seconds, clock = time.perf_counter() - clock, time.perf_counter()
    losses = []
    for done in range(a_call, updates + 1, a_call):
        carry, new = compiled(*carry)
        losses.append(np.asarray(new))
        if not np.isfinite(losses[-1]).all():
            raise TrainingError(
                f"the metric's loss is not finite after {done} updates (learning rate {learning_rate}). Lower the "
                "learning rate, or raise the diagonal offset."
            )
        if progress is not None:
            progress(done, float(losses[-1][-1].mean()))
    loop_seconds = time.perf_counter() - clock
    return MetricFit(replace(factors, weights=carry[0]), np.concatenate(losses), compilation_seconds, loop_seconds)
