"""Quotients that are 0 / 0 at zero and smooth all the same."""

import jax.numpy as jnp

_TANH_SERIES = (1.0, -1 / 3, 2 / 15, -17 / 315, 62 / 2835, -1382 / 155925, 21844 / 6081075, -929569 / 638512875)


def tanh_ratio(square):
    """`tanh(z) / z` from `square = z^2`, with derivatives that exist at z = 0."""
    # Near z = 0 the derivatives of the quotient are differences of large numbers: a series.
    small = square < 0.03
    z = jnp.sqrt(jnp.where(small, 1.0, square))
    v = jnp.where(small, square, 0.0)
    near = jnp.zeros_like(square)
    for coefficient in reversed(_TANH_SERIES):
        near = near * v + coefficient
    return jnp.where(small, near, jnp.tanh(z) / z)


def decay_ratio(v):
    """`(1 - exp(-v)) / v` for v >= 0, with derivatives that exist at v = 0."""
    # Near v = 0 the derivatives of the quotient are differences of large numbers: a series.
    small = v < 0.03
    u, far = jnp.where(small, v, 0.0), jnp.where(small, 1.0, v)
    near = jnp.zeros_like(v)
    for k in range(9, 0, -1):
        near = 1 - u / (k + 1) * near
    return jnp.where(small, near, -jnp.expm1(-far) / far)


def log_cosh(square):
    """`log cosh z` from `square = z^2`, with derivatives that exist at z = 0."""
    # The derivative by the square is tanh_ratio / 2, so its series is that one's integral.
    small = square < 0.03
    z = jnp.sqrt(jnp.where(small, 1.0, square))
    v = jnp.where(small, square, 0.0)
    near = jnp.zeros_like(square)
    for k, coefficient in reversed(list(enumerate(_TANH_SERIES))):
        near = near * v + coefficient / (2 * (k + 1))
    return jnp.where(small, near * v, z + jnp.log1p(jnp.exp(-2 * z)) - jnp.log(jnp.asarray(2.0, z.dtype)))
