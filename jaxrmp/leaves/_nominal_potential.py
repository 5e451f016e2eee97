"""The potential that is learned around one nominal demonstration."""

import math

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from .._pytree import pytree
from ._gaussian_well import tanh_ratio


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


@jax.custom_jvp
def _potential(x, points, biases, end_slope, width, sharpness):
    """`Phi(x)`, all of one dtype, with its slope in x written out: autodiff's takes ten times as long."""
    return _by_definition(x, points, biases, end_slope, width, sharpness)


def _by_definition(x, points, biases, end_slope, width, sharpness):
    square, weights = _distances_and_weights(x, points, width)
    valley = weights @ (log_cosh_of_square(square, sharpness) + biases)
    return valley - jnp.exp(-square[-1] / (2 * width**2)) * ((x - points[-1]) @ end_slope)


def _slope(x, points, biases, end_slope, width, sharpness):
    """`sum_t c_t (x - z_t) - end`, `c_t = w_t (tanh(sharpness r_t) / r_t - (h_t - mean) / width^2)`, h the heights."""
    square, weights = _distances_and_weights(x, points, width)
    heights = log_cosh_of_square(square, sharpness) + biases
    pull = sharpness * tanh_ratio(sharpness**2 * square)
    c = weights * (pull - (heights - weights @ heights) / width**2)
    offset = x - points[-1]
    bell = jnp.exp(-square[-1] / (2 * width**2))
    # As one product with the points; the offsets from them, an array for every x, would cost more than all the rest.
    return jnp.sum(c) * x - c @ points - bell * (end_slope - offset * (offset @ end_slope) / width**2)


def _derivative(primals, tangents):
    x, *parameters = primals
    value = _potential(*primals)
    total = jnp.zeros_like(value)
    if not isinstance(tangents[0], SymbolicZero):
        total = total + _slope(*primals) @ tangents[0]
    if not all(isinstance(t, SymbolicZero) for t in tangents[1:]):
        moves = [
            jnp.zeros_like(p) if isinstance(t, SymbolicZero) else t
            for p, t in zip(parameters, tangents[1:], strict=True)
        ]
        _, change = jax.jvp(lambda *parameters: _by_definition(x, *parameters), tuple(parameters), tuple(moves))
        total = total + change
    return value, total


_potential.defjvp(_derivative, symbolic_zeros=True)


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
    z_square = sharpness * sharpness * square
    # Near r = 0 the slope tanh(sharpness r) / r is a quotient of rounding errors, and the Hessian with it: a series.
    small = z_square < 1e-6
    r = jnp.sqrt(jnp.where(small, 1.0, square))
    # log1p would be no better, the sum being at least as large as log 2, but it is several times slower.
    far = r + jnp.log(1 + jnp.exp(-2 * sharpness * r)) / sharpness
    near = (math.log(2.0) + z_square / 2 - z_square * z_square / 12) / sharpness
    return jnp.where(small, near, far)
