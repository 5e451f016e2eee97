"""The barrier that keeps a distance positive: a wall with an inertia and a damping of its own."""

import jax
import jax.numpy as jnp


def ramp(d: jax.Array, reach: jax.Array | float) -> tuple[jax.Array, jax.Array]:
    """`w = max(reach - d, 0) / d` and `dw/dd`, for positive distances d. Zero from `reach` on."""
    w = jnp.maximum(reach - d, 0) / d
    return w, jnp.where(d < reach, -reach / (d * d), 0)


def wall(w: jax.Array, slope: jax.Array, beyond: jax.Array) -> jax.Array:
    """`1/2 w^2`, continued along its tangent `beyond` (not above zero) the place where w and its slope were taken."""
    return 0.5 * w * w + w * slope * beyond


def wall_inertia(w: jax.Array, slope: jax.Array) -> jax.Array:
    """`(dw/dd)^2 w^2 / (1 + w^2)`: with it over `frequency^2` as its metric, and damped at `2 frequency`, a wall of
    `1/2 w^2` is, seen from w and where w is not small, a critically damped spring of that frequency, however near."""
    return slope * slope * w * w / (1 + w * w)
