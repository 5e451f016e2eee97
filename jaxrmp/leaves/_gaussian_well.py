"""The potential of a pull towards a point that is weighted by a Gaussian of the distance."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from .._linalg import matmul
from ._smooth_ratios import tanh_ratio
from ._with_slope import with_slope

_ROOTS, _ROOT_WEIGHTS = np.polynomial.legendre.leggauss(64)
_NODES, _WEIGHTS = (_ROOTS + 1) / 2, _ROOT_WEIGHTS / 2  # for the integral over [0, 1]


def by_quadrature(square, width, sharpness, near, far):
    """The well as a sum of its integrand, right to rounding for every width, sharpness and distance."""
    r = jnp.sqrt(jnp.maximum(square, 1e-30))  # at r = 0 the mixed derivatives are zero rather than NaN
    # tanh(z) = 1 - 2 / (1 + exp(2 z)): the first term has closed forms, the second decays within 20 / sharpness, and
    # the Gaussian within 9 widths. What the sum has to cover is therefore always about as long as the integrand.
    end = jnp.minimum(r, jnp.minimum(9 * width, 20 / sharpness))
    s = end * jnp.asarray(_NODES, square.dtype)
    layer = 2 * jnp.exp(-s * s / (2 * width * width)) * jax.nn.sigmoid(-2 * sharpness * s)
    bell = width * math.sqrt(math.pi / 2) * jax.scipy.special.erf(r / (math.sqrt(2) * width))
    flat = r + (jnp.log1p(jnp.exp(-2 * sharpness * r)) - math.log(2)) / sharpness
    return (near - far) * (bell - end * matmul(layer, jnp.asarray(_WEIGHTS, square.dtype))) + far * flat


def gaussian_well_slope(square, width, sharpness, near, far):
    """`d Phi / d(r^2) = 1/2 w(r) tanh(sharpness r) / r`."""
    pull = sharpness * tanh_ratio(sharpness * sharpness * square)
    return 0.5 * gaussian_weight(square, width, near, far) * pull


def gaussian_weight(square, width, near, far):
    """`w = (near - far) exp(-r^2 / (2 width^2)) + far`."""
    return (near - far) * jnp.exp(-square / (2 * width * width)) + far


gaussian_well = with_slope(by_quadrature, gaussian_well_slope)
"""`Phi = integral from 0 to r of w(s) tanh(sharpness s) ds`, `w(s) = (near - far) exp(-s^2 / (2 width^2)) + far`, of
`(square, width, sharpness, near, far)`, `square` being `r^2`; all five scalars of one dtype.

The integral has no closed form. Its value is a Gauss-Legendre sum; its derivative with respect to `square` is not that
of the sum but the integrand itself, which is exact, smooth at r = 0, and free of the sum's cost.
"""
