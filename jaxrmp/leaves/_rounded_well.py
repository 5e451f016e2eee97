"""The potential of leaves that turn things: a spring in the angle, rounded off where no direction is shorter."""

import jax
import jax.numpy as jnp

from .._linalg import matmul


def rounded_well(offset: jax.Array, scale: float, rounding: jax.Array | float) -> jax.Array:
    """`u / (1 + sqrt(1 - (1 - rounding) u))` with `u = |offset|^2 / scale`, which is `sin(t / 2)^2` of an angle t."""
    u = matmul(offset, offset) / scale
    return u / (1 + jnp.sqrt(1 - (1 - rounding) * u))
