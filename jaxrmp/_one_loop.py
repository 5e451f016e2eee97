"""Functions of small arrays that, mapped over a batch on a CPU, run as one loop of scalar arithmetic.

XLA:CPU fuses every output of a batch into a loop of its own, and computes there anew what outputs share: of a
kinematic chain, nearly everything. It also works on arrays of a state's own small sizes, which fill no vector
register. Here a function is taken apart into scalars, once, and each becomes a vector along the batch: one loop, which
computes everything once, writes all outputs, and which LLVM vectorises. A single state, and other platforms, get the
function as it stands.
"""

import contextlib
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer
from jax.extend.core import ClosedJaxpr, Literal, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir

from ._scalar_program import NotScalar, ScalarProgram, scalar_program

_FEWEST = 64  # states from which on a loop is worth it

_one_loop_p = Primitive("one_loop")
_one_loop_p.multiple_results = True


def one_loop(function: Callable[..., Any], *over: Sequence[int | None]) -> Callable[..., Any]:
    """`function`, to be mapped by `jax.vmap` over a batch: on a CPU, by one loop.

    It takes and returns pytrees of small arrays, and is made of elementwise operations, sums, products and moving
    entries about. One that is not, or that has thousands of operations, is mapped as usual. Products with numbers that
    are known to be zero are left out.

    **Arguments**: `over`, for every axis that the function is mapped over in each state of the batch, the axes of its
    arguments, as `in_axes` of `jax.vmap`; in the results these axes come last, in this order.
    """
    within = len(over)

    @functools.wraps(function)
    def looped(*arguments):
        leaves, structure = jax.tree.flatten(arguments)
        moving = [k for k, leaf in enumerate(leaves) if isinstance(leaf, jax.Array)]
        results: list[Any] = []

        def of_moving(*values):
            merged = list(leaves)
            for k, value in zip(moving, values, strict=True):
                merged[k] = value
            results[:], shape = jax.tree.flatten(function(*jax.tree.unflatten(structure, merged)))
            results.append(shape)
            return [r for r in results[:-1] if isinstance(r, jax.Array)]

        values = [leaves[k] for k in moving]
        # As one jitted whole, it need not be traced again when it is lowered.
        closed, values = _arguments_of_tracers(jax.make_jaxpr(jax.jit(of_moving))(*values), values)
        found = iter(_one_loop_p.bind(*values, jaxpr=closed, axes=0, within=within))
        *results, shape = results  # numbers stay numbers, for what comes after to make use of
        return jax.tree.unflatten(shape, [next(found) if isinstance(r, jax.Array) else r for r in results])

    for axes in over:
        looped = jax.vmap(looped, in_axes=tuple(axes), out_axes=-1)
    return looped


def _arguments_of_tracers(closed: ClosedJaxpr, values: list) -> tuple[ClosedJaxpr, list]:
    """The same function, with what it closes over and is being traced itself as its first arguments."""
    jaxpr, consts = closed.jaxpr, closed.consts
    traced = [k for k, c in enumerate(consts) if isinstance(c, Tracer)]
    if not traced:
        return closed, values
    known = [k for k in range(len(consts)) if k not in traced]
    opened = jaxpr.replace(
        constvars=[jaxpr.constvars[k] for k in known],
        invars=[*(jaxpr.constvars[k] for k in traced), *jaxpr.invars],
    )
    return ClosedJaxpr(opened, [consts[k] for k in known]), [*(consts[k] for k in traced), *values]


def _shapes(*values, jaxpr, axes, within):
    batch = _batch_of(values, axes)
    return [a.update(shape=(*a.shape, *batch)) for a in jaxpr.out_avals]


def _batch_of(values, axes):
    """The sizes of the mapped axes, which come last; of arguments that are not mapped over one, it is 1."""
    return jnp.broadcast_shapes((1,) * axes, *(v.shape[v.ndim - axes :] for v in values))


def _mapped(*values, jaxpr, axes, within, call=lambda jaxpr, values: jaxpr_as_fun(jaxpr)(*values)):
    """The function by `jax.vmap`: over the batch first, then over what each state is mapped over, in order."""
    if axes == 0:
        return call(jaxpr, values)
    of_batch = axes > within
    inner = functools.partial(_mapped, jaxpr=jaxpr, axes=axes - 1, within=min(within, axes - 1), call=call)
    places = [v.ndim - 1 if of_batch else v.ndim - axes for v in values]
    results = [a.ndim + axes - 1 if of_batch else a.ndim for a in jaxpr.out_avals]
    still = [v.shape[k] == 1 for v, k in zip(values, places, strict=True)]
    # First, where what is mapped is the batch: there arrays are fastest if a state's entries are next to each other.
    values = [v.squeeze(k) if s else jnp.moveaxis(v, k, 0) for v, k, s in zip(values, places, still, strict=True)]
    found = inner(*values) if all(still) else jax.vmap(inner, in_axes=[None if s else 0 for s in still])(*values)
    if all(still):
        return [jnp.expand_dims(v, k) for v, k in zip(found, results, strict=True)]
    return [jnp.moveaxis(v, 0, k) for v, k in zip(found, results, strict=True)]


def _one_by_one(jaxpr, values):
    """Its operations one after the other, where nothing is compiled as a whole."""
    if any(equation.primitive.name != "jit" for equation in jaxpr.jaxpr.eqns):  # traced while jit was disabled
        return jaxpr_as_fun(jaxpr)(*values)
    found = dict(zip((*jaxpr.jaxpr.constvars, *jaxpr.jaxpr.invars), (*jaxpr.consts, *values), strict=True))

    def read(v):
        return v.val if isinstance(v, Literal) else found[v]

    for equation in jaxpr.jaxpr.eqns:  # one, of the whole
        inner = jaxpr_as_fun(equation.params["jaxpr"])
        found.update(zip(equation.outvars, inner(*map(read, equation.invars)), strict=True))
    return [read(v) for v in jaxpr.jaxpr.outvars]


def _batch(values, dimensions, *, jaxpr, axes, within):
    moved = [v[..., None] if d is None else jnp.moveaxis(v, d, -1) for v, d in zip(values, dimensions, strict=True)]
    found = _one_loop_p.bind(*moved, jaxpr=jaxpr, axes=axes + 1, within=within)
    return found, [v.ndim - 1 for v in found]


def _push(primals, tangents, *, jaxpr, axes, within):
    function = functools.partial(_mapped, jaxpr=jaxpr, axes=axes, within=within)
    return jax.jvp(function, primals, tuple(ad.instantiate_zeros(t) for t in tangents))


def _lower_on_cpu(context, *values, jaxpr, axes, within):
    function: Any = functools.partial(_mapped, jaxpr=jaxpr, axes=axes, within=within)
    if axes > within and all(isinstance(n, int) for a in context.avals_in for n in a.shape):
        batch = _batch_of(context.avals_in, axes)
        if math.prod(batch[within:]) >= _FEWEST and 0 not in batch:
            with contextlib.suppress(NotScalar):
                function = functools.partial(_in_one_loop, program=scalar_program(jaxpr), batch=batch)
    return mlir.lower_fun(function, multiple_results=True)(context, *values)


def _in_one_loop(*values: jax.Array, program: ScalarProgram, batch: tuple[int, ...]) -> list[jax.Array]:
    """The scalar program on vectors along the batch.

    XLA has no elementwise operation of many results, but it has reductions of many operands at once, and fuses into one
    all that its operands are made of. So each result is there twice, and the larger of two equal numbers is taken; LLVM
    sees that they are the same.
    """
    N = math.prod(batch)

    def entry(step):
        v = values[step.argument]
        sizes = v.shape[v.ndim - len(batch) :]
        return jnp.broadcast_to(lax.index_in_dim(v.reshape(-1, *sizes), step.entry, keepdims=False), batch).reshape(N)

    computed = list(dict.fromkeys(x for o in program.outputs for x in o.reshape(-1) if program.computes(x)))
    value = program.evaluate(entry, lambda x: jnp.full(N, x))
    results: Sequence[jax.Array] = [value(x) for x in computed]
    if len(results) > 1:
        twice = [jnp.broadcast_to(x, (2, N)) for x in results]
        least = [_least(x.dtype) for x in results]
        results = lax.reduce(twice, least, lambda a, b: [jnp.maximum(*pair) for pair in zip(a, b, strict=True)], (0,))
    found = dict(zip(computed, results, strict=True))

    def vector(x):
        if program.computes(x):
            return found[x]
        return entry(program.steps[x]) if isinstance(x, int) else jnp.full(N, x)

    return [jnp.stack([vector(x) for x in o.reshape(-1)]).reshape(*o.shape, *batch) for o in program.outputs]


def _least(dtype):
    if dtype.kind == "b":
        return np.False_
    return np.array(-np.inf if jnp.issubdtype(dtype, jnp.floating) else jnp.iinfo(dtype).min, dtype)


_one_loop_p.def_impl(functools.partial(_mapped, call=_one_by_one))
_one_loop_p.def_abstract_eval(_shapes)
batching.primitive_batchers[_one_loop_p] = _batch
ad.primitive_jvps[_one_loop_p] = _push
mlir.register_lowering(_one_loop_p, mlir.lower_fun(_mapped, multiple_results=True))
mlir.register_lowering(_one_loop_p, _lower_on_cpu, platform="cpu")
