"""The network that gives a learned metric its Cholesky factor, evaluated by JAX alone."""

import itertools
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp

from .._errors import UnknownNameError
from .._linalg import matmul
from .._pytree import pytree, static
from ._configuration import ACTIVATIONS
from ._support import Support


def cholesky_network(
    weights: Mapping[str, Any], hidden: int, activation: str, offset: float, x: jax.Array
) -> jax.Array:
    """Fully connected layers from a position x [m] to the lower triangular matrix [m, m] of a Cholesky factor.

    The last layer is linear; absolute values plus `offset` give the diagonal. Rana et al. 2019, section 3.2.

    **Arguments**: `weights`, of the `hidden` layers, then the diagonal's and those of the entries below it, as flax
    names them: `Dense_0` and so on, each with `kernel` and `bias`; `activation`, a name of `jax.nn`.
    """

    def dense(layer: int, y: jax.Array) -> jax.Array:
        return matmul(y, weights[f"Dense_{layer}"]["kernel"]) + weights[f"Dense_{layer}"]["bias"]

    for layer in range(hidden):
        x = getattr(jax.nn, activation)(dense(layer, x))
    return _lower_triangular(jnp.abs(dense(hidden, x)) + offset, dense(hidden + 1, x))


def cholesky_shapes(dimension: int, hidden: tuple[int, ...]) -> dict[str, dict[str, tuple[int, ...]]]:
    """The shapes of the weights of `cholesky_network`, whose `hidden` layers have these widths."""
    widths, m = (dimension, *hidden), dimension
    ends = [*itertools.pairwise(widths), (widths[-1], m), (widths[-1], m * (m - 1) // 2)]
    return {f"Dense_{layer}": {"bias": (b,), "kernel": (a, b)} for layer, (a, b) in enumerate(ends)}


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
        weights = jax.tree.map(lambda w: jnp.asarray(w, x.dtype), self.weights)
        x_scaled = x / jnp.asarray(self.length_scale, x.dtype)
        L = cholesky_network(weights, len(self.hidden), self.activation, self.offset, x_scaled)
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

    `key` draws the weights, by flax; the rest as `CholeskyFactor`.
    **Raises** `UnknownNameError` for another activation, `MissingDependencyError` where flax is not installed.
    """
    from ._initial_weights import initial_weights

    UnknownNameError.check("activation", activation, ACTIVATIONS)
    weights = initial_weights(key, dimension, tuple(hidden), offset)
    return CholeskyFactor(weights, jnp.asarray(length_scale), support, dimension, tuple(hidden), activation, offset)
