"""Keep XLA from computing what many outputs share again for every one of them.

XLA:CPU fuses each output of a batch into a loop of its own and evaluates there anew what it is made of: of a kinematic
chain the sines and cosines, two thirds of the run time at batch 4,096; of distances pulled back, normals and metrics
nine times. It ignores `lax.optimization_barrier`, but it never fuses across a matrix product, so the product with
a small identity, which is exact, makes them be written out once. A single state is faster without, and other platforms
do not need it.
"""

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

_materialise_p = Primitive("materialise")


def materialise(x: jax.Array) -> jax.Array:
    """Return `x` unchanged; in a batch on a CPU, written to memory once.

    A number there that is not finite spreads as NaN over up to sixteen neighbours of its own state.
    """
    return _materialise_p.bind(x.reshape(-1)).reshape(x.shape)


def _batch(arguments, dimensions):
    (x,), (d,) = arguments, dimensions
    return _materialise_p.bind(jnp.moveaxis(x, d, 0)), 0


def _times_identity(x):
    m = x.shape[-1]
    if x.ndim < 2 or m == 0:
        return x
    width = max(w for w in range(1, 17) if m % w == 0)
    if width < 4 < m:  # no divisor that is worth a product: fill up
        padded = jnp.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, -m % 8)])
        return _times_identity(padded)[..., :m]
    rows = jnp.matmul(x.reshape(-1, width), jnp.eye(width, dtype=x.dtype), precision=jax.lax.Precision.HIGHEST)
    return rows.reshape(x.shape)


_materialise_p.def_impl(lambda x: x)
_materialise_p.def_abstract_eval(lambda x: x)
batching.primitive_batchers[_materialise_p] = _batch
ad.deflinear2(_materialise_p, lambda cotangent, x: [cotangent])
mlir.register_lowering(_materialise_p, lambda context, x: [x])
mlir.register_lowering(_materialise_p, mlir.lower_fun(_times_identity, multiple_results=False), platform="cpu")
