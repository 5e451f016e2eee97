"""Natural forms of policies that treat every coordinate alike."""

import jax
import jax.numpy as jnp

from ..._forms import DiagonalForm


def elementwise(a: jax.Array, m: jax.Array, x: jax.Array) -> DiagonalForm:
    """The form of one scalar policy a coordinate: accelerations `a` and metrics `m`, both in the shape of x.

    `x` is one vector [m] or K points [K, m].
    """
    m = jnp.broadcast_to(m, x.shape).astype(x.dtype)
    return DiagonalForm((m * a).astype(x.dtype), m)


def closed_gate(speed: jax.Array) -> jax.Array:
    """`1 / (1 + exp(speed))`: about 1 when approaching (speed < 0), 1/2 at rest, about 0 when leaving."""
    return jax.nn.sigmoid(-speed)
