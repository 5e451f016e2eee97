"""The potential of a pull towards a point that is weighted by a Gaussian of the distance."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

_ROOTS, _ROOT_WEIGHTS = np.polynomial.legendre.leggauss(64)
_NODES, _WEIGHTS = (_ROOTS + 1) / 2, _ROOT_WEIGHTS / 2  # for the integral over [0, 1]
_TANH_SERIES = (1.0, -1 / 3, 2 / 15, -17 / 315, 62 / 2835, -1382 / 155925, 21844 / 6081075, -929569 / 638512875)


@jax.custom_jvp
def gaussian_well(square, width, sharpness, near, far):
    """`Phi = integral from 0 to r of w(s) tanh(sharpness s) ds`, `w(s) = (near - far) exp(-s^2 / (2 width^2)) + far`.

    **Arguments**: `square` is `r^2`; all five scalars of one dtype.
    The integral has no closed form. Its value is a Gauss-Legendre sum, right to rounding for every width, sharpness
    and distance; its derivative with respect to `square` is not that of the sum but the integrand itself, which is
    exact, smooth at r = 0, and free of the sum's cost. Derivatives with respect to the others are those of the sum.
    """
    return by_quadrature(square, width, sharpness, near, far)


def by_quadrature(square, width, sharpness, near, far):
    """The same, as a sum throughout."""
    r = jnp.sqrt(jnp.maximum(square, 1e-30))  # at r = 0 the mixed derivatives are zero rather than NaN
    # tanh(z) = 1 - 2 / (1 + exp(2 z)): the first term has closed forms, the second decays within 20 / sharpness, and
    # the Gaussian within 9 widths. What the sum has to cover is therefore always about as long as the integrand.
    end = jnp.minimum(r, jnp.minimum(9 * width, 20 / sharpness))
    s = end * jnp.asarray(_NODES, square.dtype)
    layer = 2 * jnp.exp(-s * s / (2 * width * width)) * jax.nn.sigmoid(-2 * sharpness * s)
    bell = width * math.sqrt(math.pi / 2) * jax.scipy.special.erf(r / (math.sqrt(2) * width))
    flat = r + (jnp.log1p(jnp.exp(-2 * sharpness * r)) - math.log(2)) / sharpness
    return (near - far) * (bell - end * (layer @ jnp.asarray(_WEIGHTS, square.dtype))) + far * flat


def _derivative(primals, tangents):
    square, *parameters = primals
    value = gaussian_well(*primals)
    total = jnp.zeros_like(value)
    if not isinstance(tangents[0], SymbolicZero):
        total = total + gaussian_well_slope(*primals) * tangents[0]
    if not all(isinstance(t, SymbolicZero) for t in tangents[1:]):
        moves = [
            jnp.zeros_like(p) if isinstance(t, SymbolicZero) else t
            for p, t in zip(parameters, tangents[1:], strict=True)
        ]
        _, change = jax.jvp(lambda *parameters: by_quadrature(square, *parameters), tuple(parameters), tuple(moves))
        total = total + change
    return value, total


gaussian_well.defjvp(_derivative, symbolic_zeros=True)


def gaussian_well_slope(square, width, sharpness, near, far):
    """`d Phi / d(r^2) = 1/2 w(r) tanh(sharpness r) / r`."""
    pull = sharpness * tanh_ratio(sharpness * sharpness * square)
    return 0.5 * gaussian_weight(square, width, near, far) * pull


def gaussian_weight(square, width, near, far):
    """`w = (near - far) exp(-r^2 / (2 width^2)) + far`."""
    return (near - far) * jnp.exp(-square / (2 * width * width)) + far


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
