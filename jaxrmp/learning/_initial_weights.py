"""The metric network's weights before training. The only module that knows flax."""

from typing import Any

import jax
import jax.numpy as jnp

from .._errors import importing

with importing("flax", "learning"):
    import flax.linen as nn


class _Layers(nn.Module):
    """The layers of `cholesky_network`, in its order; the diagonal starts at one, entries below it near zero."""

    dimension: int
    hidden: tuple[int, ...]
    offset: float

    @nn.compact
    def __call__(self, x):
        m, small = self.dimension, nn.initializers.normal(0.01)
        for width in self.hidden:
            x = nn.Dense(width)(x)
        diagonal = nn.Dense(m, kernel_init=small, bias_init=nn.initializers.constant(1 - self.offset))(x)
        return diagonal, nn.Dense(m * (m - 1) // 2, kernel_init=small)(x)


def initial_weights(key: jax.Array, dimension: int, hidden: tuple[int, ...], offset: float) -> Any:
    """The weights of `cholesky_network` that `key` draws, for a factor near the identity everywhere."""
    return _Layers(dimension, hidden, offset).init(key, jnp.zeros(dimension))["params"]
