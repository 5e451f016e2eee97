"""Keep XLA from computing what many outputs share again for every one of them.

XLA:CPU fuses each output of a batch into a loop of its own and evaluates there anew what it is made of: of a kinematic
chain the sines and cosines, two thirds of the run time at batch 4,096. What is small becomes one loop of scalars
(`_one_loop.py`); this is for what is not, and for slopes. A single state is faster without what helps against that,
and other platforms do not need it: so nothing here is done but for a batch on a CPU.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from ._switch import is_on

_materialise_p = Primitive("materialise")
_concatenated_p = Primitive("concatenated")
_concatenated_p.multiple_results = True


def materialise(x: jax.Array) -> jax.Array:
    """Return `x` unchanged; in a batch on a CPU, written to memory once.

    XLA:CPU ignores `lax.optimization_barrier`, but it never fuses across a matrix product, so the product with a small
    identity, which is exact, makes `x` be written out. A number there that is not finite spreads as NaN over up to
    sixteen neighbours of its own state.
    """
    return _materialise_p.bind(x.reshape(-1)).reshape(x.shape) if is_on() else x


def concatenated(groups: Sequence[Sequence[jax.Array]]) -> tuple[jax.Array, ...]:
    """Every one of `groups` of vectors as one vector; in a batch on a CPU, all of them by one loop.

    That loop has the entries of all groups next to each other, and computes what they share once. Groups are alike,
    array by array: vector k has the same size in each.
    """
    if not groups:
        return ()
    if not is_on():
        return tuple(jnp.concatenate(group) for group in groups)
    return tuple(_concatenated_p.bind(*(x for group in groups for x in group), count=len(groups)))


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


def _one_by_one(*arrays, count):
    size = len(arrays) // count
    return [jnp.concatenate(arrays[k : k + size], axis=-1) for k in range(0, len(arrays), size)]


def _by_one_loop(*arrays, count):
    if arrays[0].ndim < 2:
        return _one_by_one(*arrays, count=count)
    joined = jnp.concatenate(arrays, axis=-1)
    rows = joined.reshape(*joined.shape[:-1], count, -1)  # XLA sees through slices of a concatenation, but not of this
    return [rows[..., k, :] for k in range(count)]


def _shapes(*arrays, count):
    length = sum(x.shape[-1] for x in arrays[: len(arrays) // count])
    return [arrays[0].update(shape=(*arrays[0].shape[:-1], length))] * count


def _batch_all(arguments, dimensions, *, count):
    B = next(x.shape[d] for x, d in zip(arguments, dimensions, strict=True) if d is not None)
    moved = [
        jnp.broadcast_to(x, (B, *x.shape)) if d is None else jnp.moveaxis(x, d, 0)
        for x, d in zip(arguments, dimensions, strict=True)
    ]
    return _concatenated_p.bind(*moved, count=count), [0] * count


def _push(primals, tangents, *, count):
    filled = [ad.instantiate_zeros(t) for t in tangents]
    return _concatenated_p.bind(*primals, count=count), _concatenated_p.bind(*filled, count=count)


def _pull(cotangents, *arrays, count):
    ends = np.cumsum([x.aval.shape[-1] for x in arrays[: len(arrays) // count]])[:-1]
    return [part for c in cotangents for part in jnp.split(ad.instantiate_zeros(c), ends, axis=-1)]


_concatenated_p.def_impl(_one_by_one)
_concatenated_p.def_abstract_eval(_shapes)
batching.primitive_batchers[_concatenated_p] = _batch_all
ad.primitive_jvps[_concatenated_p] = _push
ad.primitive_transposes[_concatenated_p] = _pull
mlir.register_lowering(_concatenated_p, mlir.lower_fun(_one_by_one, multiple_results=True))
mlir.register_lowering(_concatenated_p, mlir.lower_fun(_by_one_loop, multiple_results=True), platform="cpu")
