"""The potential that is learned around one nominal demonstration."""

import math

import jax
import jax.numpy as jnp

from .._pytree import pytree


@pytree
class NominalPotential:
    """A valley along a nominal trajectory, falling to its end at the origin.

    `Phi(x) = sum_t w_t(x) (phi_perp(x - z_t) + bias_t) - g . (x - z_T) exp(-|x - z_T|^2 / (2 width^2))` with
    `w` the softmax of `-|x - z_t|^2 / (2 width^2)` and `phi_perp(d) = log(2 cosh(sharpness |d|)) / sharpness`. The
    last term cancels the slope g that the sum has at the end point `z_T`, so that it is exactly stationary there.

    **Arguments**: `points` z [T, m], the nominal trajectory, metres; `biases` [T], metres, not rising in t;
    `end_slope` g [m]; `width`, kernel width, metres; `sharpness` eta, 1/m: beyond 1/eta from the trajectory the pull
    towards it has unit slope.

    >>> points, biases = jnp.array([[1.0, 0.0], [0.0, 0.0]]), jnp.array([1.0, 0.0])
    >>> valley = NominalPotential(points, biases, jnp.zeros(2), width=0.1, sharpness=50.0)
    >>> round(float(valley(points[0]) - valley(points[1])), 4)
    1.0

    Rana et al. 2019, equations 4 to 6, with the end correction of this library. Smooth everywhere.
    """

    points: jax.Array
    biases: jax.Array
    end_slope: jax.Array
    width: jax.Array | float
    sharpness: jax.Array | float

    def __call__(self, x: jax.Array) -> jax.Array:
        """`Phi(x)`, in metres, at one point x [m]."""
        offset = x - jnp.asarray(self.points, x.dtype)
        square = jnp.sum(offset * offset, axis=-1)
        # Far away every kernel underflows, and the plain quotient of kernels with it; the softmax does not.
        weights = jax.nn.softmax(-square / (2 * self.width**2))
        at_end = jnp.exp(-square[-1] / (2 * self.width**2)) * (offset[-1] @ jnp.asarray(self.end_slope, x.dtype))
        valley = weights @ (log_cosh_of_square(square, self.sharpness) + self.biases)
        return (valley - at_end).astype(x.dtype)


def log_cosh_of_square(square: jax.Array, sharpness: jax.Array | float) -> jax.Array:
    """`log(2 cosh(sharpness r)) / sharpness` from `square = r^2`, with derivatives that exist at r = 0."""
    z_square = sharpness * sharpness * square
    # Near r = 0 the slope tanh(sharpness r) / r is a quotient of rounding errors, and the Hessian with it: a series.
    small = z_square < 1e-6
    r = jnp.sqrt(jnp.where(small, 1.0, square))
    far = r + jnp.log1p(jnp.exp(-2 * sharpness * r)) / sharpness
    near = (math.log(2.0) + z_square / 2 - z_square * z_square / 12) / sharpness
    return jnp.where(small, near, far)
