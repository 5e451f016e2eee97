"""The potential that is learned around one nominal demonstration."""

import math

import jax
import jax.numpy as jnp

from .._linalg import matmul
from .._pytree import pytree
from ._with_slope import with_slope


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
        fields = (self.points, self.biases, self.end_slope, self.width, self.sharpness)
        return _potential(x, *(jnp.asarray(field, x.dtype) for field in fields))


def _by_definition(x, points, biases, end_slope, width, sharpness):
    """`Phi(x)`, all of one dtype."""
    square, weights = _distances_and_weights(x, points, width)
    valley = matmul(weights, log_cosh_of_square(square, sharpness) + biases)
    return valley - jnp.exp(-square[-1] / (2 * width**2)) * matmul(x - points[-1], end_slope)


def _slope(x, points, biases, end_slope, width, sharpness):
    """`sum_t c_t (x - z_t) - end`, `c_t = w_t (tanh(sharpness r_t) / r_t - (h_t - mean) / width^2)`, h the heights."""
    square, weights = _distances_and_weights(x, points, width)
    heights = log_cosh_of_square(square, sharpness) + biases
    pull = _tanh_ratio_of_square(square, sharpness)
    c = weights * (pull - (heights - matmul(weights, heights)) / width**2)
    offset = x - points[-1]
    bell = jnp.exp(-square[-1] / (2 * width**2))
    # As one product with the points; the offsets from them, an array for every x, would cost more than all the rest.
    return jnp.sum(c) * x - matmul(c, points) - bell * (end_slope - offset * matmul(offset, end_slope) / width**2)


_potential = with_slope(_by_definition, _slope)  # the slope that autodiff writes takes ten times as long


def _distances_and_weights(x, points, width):
    """Squared distances to the points [T], and the kernels' shares there [T]."""
    # Coordinate by coordinate, since XLA does badly with arrays whose last axis is as short as 3.
    square = jnp.zeros(points.shape[:1], x.dtype)
    for i in range(points.shape[1]):
        square = square + (x[i] - points[:, i]) ** 2
    # Far away every kernel underflows, and the plain quotient of kernels with it; the softmax does not.
    return square, jax.nn.softmax(-square / (2 * width**2))


def log_cosh_of_square(square: jax.Array, sharpness: jax.Array | float) -> jax.Array:
    """`log(2 cosh(sharpness r)) / sharpness` from `square = r^2`, with derivatives that exist at r = 0."""
    z_square, small, r, decay = _of_square(square, sharpness)
    # log1p would be no better, the sum being at least as large as log 2, but it is several times slower.
    far = r + jnp.log(1 + decay) / sharpness
    return jnp.where(small, _series(z_square, _LOG_COSH) / sharpness, far)


def _tanh_ratio_of_square(square, sharpness):
    """`tanh(sharpness r) / r` from `square = r^2`; of the same parts as `log_cosh_of_square`, which costs less."""
    z_square, small, r, decay = _of_square(square, sharpness)
    return jnp.where(small, sharpness * _series(z_square, _TANH_RATIO), (1 - decay) / ((1 + decay) * r))


# Coefficients of powers of z^2, for z^2 < _SMALL: near r = 0 quotients and their derivatives are of rounding errors.
_SMALL = 0.03
_LOG_COSH = (math.log(2.0), 1 / 2, -1 / 12, 1 / 45, -17 / 2520, 31 / 14175)
_TANH_RATIO = (1.0, -1 / 3, 2 / 15, -17 / 315, 62 / 2835, -1382 / 155925)


def _of_square(square, sharpness):
    z_square = sharpness * sharpness * square
    small = z_square < _SMALL
    r = jnp.sqrt(jnp.where(small, 1.0, square))
    return jnp.where(small, z_square, 0.0), small, r, jnp.exp(-2 * sharpness * r)


def _series(x, coefficients):
    total = jnp.zeros_like(x)
    for coefficient in reversed(coefficients):
        total = total * x + coefficient
    return total
