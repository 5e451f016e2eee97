"""Keep XLA from computing sines and cosines again for every output of a batch.

XLA:CPU fuses each output of a batched kinematic chain into a loop of its own and evaluates the sines and cosines
anew in each: at batch 4,096 that is two thirds of the run time. It ignores `lax.optimization_barrier`, but it never
fuses across a matrix product, so the product with the identity, which is exact, makes them be written out once.
A single configuration is faster without, and other platforms do not need it.
"""

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

_materialise_p = Primitive("materialise")


def materialise(x: jax.Array) -> jax.Array:
    """Return `x` [m] unchanged; in a batch on a CPU, written to memory once. A NaN there spreads over its own [m]."""
    return _materialise_p.bind(x)


def _batch(arguments, dimensions):
    (x,), (d,) = arguments, dimensions
    return _materialise_p.bind(jnp.moveaxis(x, d, 0)), 0


def _times_identity(x):
    if x.ndim < 2:
        return x
    return jnp.matmul(x, jnp.eye(x.shape[-1], dtype=x.dtype), precision=jax.lax.Precision.HIGHEST)


_materialise_p.def_impl(lambda x: x)
_materialise_p.def_abstract_eval(lambda x: x)
batching.primitive_batchers[_materialise_p] = _batch
ad.deflinear2(_materialise_p, lambda cotangent, x: [cotangent])
mlir.register_lowering(_materialise_p, lambda context, x: [x])
mlir.register_lowering(_materialise_p, mlir.lower_fun(_times_identity, multiple_results=False), platform="cpu")
