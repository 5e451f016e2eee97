"""Functions whose slope is known better than autodiff would find it."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero


def with_slope(value: Callable[..., jax.Array], slope: Callable[..., jax.Array]) -> Callable[..., jax.Array]:
    """The scalar function `value(x, *parameters)`, differentiated in x by `slope(x, *parameters)`, of the shape of x.

    Derivatives in the parameters are autodiff's of `value`, and cost nothing where none are asked for.
    """

    @jax.custom_jvp
    def function(x, *parameters):
        return value(x, *parameters)

    def derivative(primals, tangents):
        x, *parameters = primals
        result = function(*primals)
        total = jnp.zeros_like(result)
        if not isinstance(tangents[0], SymbolicZero):
            total = total + jnp.sum(slope(*primals) * tangents[0])
        if not all(isinstance(t, SymbolicZero) for t in tangents[1:]):
            moves = [
                jnp.zeros_like(p) if isinstance(t, SymbolicZero) else t
                for p, t in zip(parameters, tangents[1:], strict=True)
            ]
            _, change = jax.jvp(lambda *parameters: value(x, *parameters), tuple(parameters), tuple(moves))
            total = total + change
        return result, total

    function.defjvp(derivative, symbolic_zeros=True)
    return function
