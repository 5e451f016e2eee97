"""The network that gives a learned metric its Cholesky factor. The only module that knows flax."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.lax import Precision

from .._errors import UnknownNameError, importing
from .._pytree import pytree, static
from ._configuration import ACTIVATIONS
from ._support import Support

with importing("flax", "learning"):
    import flax.linen as nn


class CholeskyNetwork(nn.Module):
    """Fully connected layers from a position to the entries of a lower triangular matrix; it starts at the identity.

    The last layer is linear; absolute values plus `offset` give the diagonal. Rana et al. 2019, section 3.2.
    """

    dimension: int
    hidden: tuple[int, ...]
    activation: str
    offset: float
    param_dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, x):
        m, dense = self.dimension, partial(nn.Dense, param_dtype=self.param_dtype, precision=Precision.HIGHEST)
        for width in self.hidden:
            x = getattr(nn, self.activation)(dense(width)(x))
        small = nn.initializers.normal(0.01)
        diagonal = dense(m, kernel_init=small, bias_init=nn.initializers.constant(1 - self.offset))(x)
        below = dense(m * (m - 1) // 2, kernel_init=small)(x)
        return _lower_triangular(jnp.abs(diagonal) + self.offset, below)


def _lower_triangular(diagonal, below):
    """The matrix of these entries [m] and [m (m - 1) / 2], row by row; by slices, which XLA fuses, and no scatter."""
    m, blank = diagonal.shape[0], jnp.zeros_like(diagonal)
    rows = [
        jnp.concatenate([below[i * (i - 1) // 2 : i * (i + 1) // 2], diagonal[i : i + 1], blank[i + 1 :]])
        for i in range(m)
    ]
    return jnp.stack(rows)


@pytree
class CholeskyFactor:
    """A trained Cholesky factor: `x -> L` [m, m], lower triangular, diagonal at least `offset`.

    With a support, `L = w L_network + (1 - w) I`: what a network makes of places far from all that it was trained on
    is arbitrary (it grows, and slows motion down to a crawl); there the policy descends the potential itself.

    **Arguments**: `weights`, the network's, as nested dicts of arrays; `length_scale`, metres, by which positions are
    divided on the way in; `support`, of the weight w, None for the network everywhere; `dimension` m, `hidden` layer
    widths, `activation` (relu, softplus, silu or tanh), `offset`.
    """

    weights: Any
    length_scale: jax.Array | float
    support: Support | None = None
    dimension: int = static(default=3)
    hidden: tuple[int, ...] = static(default=(128, 64))
    activation: str = static(default="relu")
    offset: float = static(default=1e-3)

    def __call__(self, x: jax.Array) -> jax.Array:
        network = CholeskyNetwork(self.dimension, self.hidden, self.activation, self.offset)
        weights = jax.tree.map(lambda w: jnp.asarray(w, x.dtype), self.weights)
        L = jnp.asarray(network.apply({"params": weights}, x / jnp.asarray(self.length_scale, x.dtype)))
        return L if self.support is None else blended(L, self.support(x))


def blended(L: jax.Array, share: jax.Array) -> jax.Array:
    """`share` of a Cholesky factor L [m, m], and the identity for the rest."""
    return share * L + (1 - share) * jnp.eye(L.shape[-1], dtype=L.dtype)


def initial_cholesky_factor(
    key: jax.Array,
    dimension: int = 3,
    hidden: tuple[int, ...] = (128, 64),
    activation: str = "relu",
    offset: float = 1e-3,
    length_scale: float = 1.0,
    support: Support | None = None,
) -> CholeskyFactor:
    """A Cholesky factor before training: near the identity everywhere.

    `key` draws the weights; the rest as `CholeskyFactor`. **Raises** `UnknownNameError` for another activation.
    """
    UnknownNameError.check("activation", activation, ACTIVATIONS)
    network = CholeskyNetwork(dimension, tuple(hidden), activation, offset)
    weights = network.init(key, jnp.zeros(dimension))["params"]
    return CholeskyFactor(weights, jnp.asarray(length_scale), support, dimension, tuple(hidden), activation, offset)
