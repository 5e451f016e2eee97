"""Functions of small arrays that, mapped over a batch on a CPU, run as one loop of scalar arithmetic.

XLA:CPU fuses every output of a batch into a loop of its own, and computes there anew what outputs share: of a
kinematic chain, nearly everything. It also works on arrays of a state's own small sizes, which fill no vector
register. Here a function is taken apart into scalars, once, and each becomes a vector along the batch: one loop, which
computes everything once, writes all outputs, and which LLVM vectorises. A single state, a small batch, and other
platforms get what `jax.vmap` makes of the function.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer
from jax.extend.core import ClosedJaxpr, Literal, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir

from ._plan import Plan, planned
from ._scalar_program import ScalarProgram
from ._switch import is_on

one_loop_p = Primitive("one_loop")


class Level(NamedTuple):
    """An axis that a function is mapped over: its size, and its place in each argument; in results it comes last."""

    size: int
    places: tuple[int | None, ...]


def one_loop(function: Callable[..., Any], *over: Sequence[int | None]) -> Callable[..., Any]:
    """`function`, to be mapped by `jax.vmap` over a batch: on a CPU, by one loop.

    It takes and returns pytrees of small arrays, and is made of elementwise operations, sums, products and moving
    entries about. One that is not, or that has thousands of operations, is mapped as usual: `report` says why. Products
    with numbers that are known to be zero are left out.

    **Arguments**: `over`, for every axis that the function is mapped over in each state of the batch, the axes of its
    arguments, as `in_axes` of `jax.vmap`; in the results these axes come last, in this order.
    """

    @functools.wraps(function)
    def looped(*arguments):
        return bound(one_loop_p, function, arguments, levels=(), within=len(over))

    @functools.wraps(function)
    def as_switched(*arguments):
        mapped = looped if is_on() else function
        for axes in over:
            mapped = jax.vmap(mapped, in_axes=tuple(axes), out_axes=-1)
        return mapped(*arguments)

    return as_switched


def bound(primitive: Primitive, function: Callable, arguments: Sequence[Any], **parameters: Any) -> Any:
    """What `function` of `arguments` gives, as one operation: a `primitive` of its jaxpr, a name, and `parameters`.

    Of arguments and results only arrays of JAX take part; all else is the function's own.
    """
    leaves, structure = jax.tree.flatten(arguments)
    # A copy, for what JAX makes of a NumPy array under jax_enable_x64 it also takes without, as long as it is kept.
    leaves = [leaf.copy() if isinstance(leaf, np.ndarray) else leaf for leaf in leaves]
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
    if closed.effects:  # of a named axis, or to be seen: not of arithmetic
        return function(*arguments)
    found = iter(primitive.bind(*values, jaxpr=closed, name=_name_of(function, arguments), **parameters))
    *results, shape = results  # numbers stay numbers, for what comes after to make use of
    return jax.tree.unflatten(shape, [next(found) if isinstance(r, jax.Array) else r for r in results])


def _name_of(function: Callable, arguments: Sequence[Any]) -> str:
    """As its code names it; a method by the class of what it belongs to."""
    while isinstance(function, functools.partial):
        function = function.func
    names = getattr(function, "__qualname__", type(function).__name__).replace("<locals>.", "").split(".")
    if len(names) == 2 and arguments and hasattr(type(arguments[0]), names[1]):
        names[0] = type(arguments[0]).__name__
    return ".".join(names)


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


def define(primitive: Primitive, mapped: Callable, shapes: Callable, batch: Callable, lower_on_cpu: Callable) -> None:
    """Make a primitive lower on a CPU in its own way; elsewhere, and with its slopes, it is what `mapped` is."""

    def push(primals, tangents, **parameters):
        function = functools.partial(mapped, **parameters)
        return jax.jvp(function, primals, tuple(ad.instantiate_zeros(t) for t in tangents))

    primitive.multiple_results = True
    primitive.def_impl(functools.partial(mapped, call=one_by_one))
    primitive.def_abstract_eval(shapes)
    batching.primitive_batchers[primitive] = batch
    ad.primitive_jvps[primitive] = push
    mlir.register_lowering(primitive, mlir.lower_fun(mapped, multiple_results=True))
    mlir.register_lowering(primitive, lower_on_cpu, platform="cpu")


def as_it_stands(jaxpr: ClosedJaxpr, *values: Any) -> list[Any]:
    """What a function gives."""
    return jaxpr_as_fun(jaxpr)(*values)


def _mapped(*values, jaxpr, levels, within, call=as_it_stands, **_):
    """The function by `jax.vmap`."""
    function = functools.partial(call, jaxpr)
    for level in levels[:within]:
        function = jax.vmap(function, in_axes=level.places, out_axes=-1)
    for level in levels[within:]:
        function = functools.partial(_over_first, function, level.places)
    return function(*values)


def _over_first(function, places, *values):
    """Over the first axis: arrays are fastest if a state's entries are next to each other."""
    first = [v if k is None else jnp.moveaxis(v, k, 0) for v, k in zip(values, places, strict=True)]
    return jax.vmap(function, in_axes=[None if k is None else 0 for k in places], out_axes=-1)(*first)


def one_by_one(jaxpr: ClosedJaxpr, *values: Any) -> list[Any]:
    """A function's operations one after the other, where nothing is compiled as a whole."""
    if any(equation.primitive.name != "jit" for equation in jaxpr.jaxpr.eqns):  # traced while jit was disabled
        return jaxpr_as_fun(jaxpr)(*values)
    found = dict(zip((*jaxpr.jaxpr.constvars, *jaxpr.jaxpr.invars), (*jaxpr.consts, *values), strict=True))

    def read(v):
        return v.val if isinstance(v, Literal) else found[v]

    for equation in jaxpr.jaxpr.eqns:  # one, of the whole
        inner = jaxpr_as_fun(equation.params["jaxpr"])
        found.update(zip(equation.outvars, inner(*map(read, equation.invars)), strict=True))
    return [read(v) for v in jaxpr.jaxpr.outvars]


def _shapes(*_values, jaxpr, levels, **_):
    return [a.update(shape=(*a.shape, *(level.size for level in levels))) for a in jaxpr.out_avals]


def _batch(values, dimensions, *, jaxpr, levels, within, name):
    size = next(v.shape[d] for v, d in zip(values, dimensions, strict=True) if d is not None)
    level = Level(size, tuple(dimensions))
    found = one_loop_p.bind(*values, jaxpr=jaxpr, levels=(*levels, level), within=within, name=name)
    return found, [v.ndim - 1 for v in found]


def plan_of(jaxpr: ClosedJaxpr, levels: tuple[Level, ...], within: int) -> Plan:
    """How a function is to be mapped over these levels on a CPU, and why."""
    return planned(jaxpr, tuple(level.size for level in levels[within:]))


def _lower_on_cpu(context, *values, jaxpr, levels, within, **_):
    plan = plan_of(jaxpr, levels, within) if is_on() and 0 not in (level.size for level in levels) else None
    if plan and plan.program:
        if plan.along:
            along = [0 if a.shape else None for a in (*jaxpr.in_avals, *plan.program.constants)]
            levels = (Level(plan.along, tuple(along)), *levels)
        function = functools.partial(_in_one_loop, program=plan.program, levels=levels)
    else:
        function = functools.partial(_mapped, jaxpr=jaxpr, levels=levels, within=within)
    return mlir.lower_fun(function, multiple_results=True)(context, *values)


def _in_one_loop(*values: jax.Array, program: ScalarProgram, levels: tuple[Level, ...]) -> list[jax.Array]:
    """The scalar program on vectors along the batch.

    XLA has no elementwise operation of many results, but it has reductions of many operands at once, and fuses into one
    all that its operands are made of. So each result is there twice, and the larger of two equal numbers is taken; LLVM
    sees that they are the same.
    """
    sizes = tuple(level.size for level in levels)
    N = math.prod(sizes)
    levels = tuple(level._replace(places=(*level.places, *[None] * len(program.constants))) for level in levels)
    values = (*values, *map(jnp.asarray, program.constants))
    values = tuple(_levels_last(v, [level.places[k] for level in levels]) for k, v in enumerate(values))

    def entry(step):
        v = values[step.argument]
        own = v.shape[v.ndim - len(levels) :]
        return jnp.broadcast_to(lax.index_in_dim(v.reshape(-1, *own), step.entry, keepdims=False), sizes).reshape(N)

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

    return [jnp.stack([vector(x) for x in o.reshape(-1)]).reshape(*o.shape, *sizes) for o in program.outputs]


def _levels_last(v: jax.Array, places: Sequence[int | None]) -> jax.Array:
    """An argument with the levels' axes behind its own, in order; 1 for a level that it is not mapped over."""
    order: list[Any] = [None] * (v.ndim - sum(place is not None for place in places))
    own = len(order)
    for n, place in enumerate(places):
        if place is not None:
            order.insert(place, n)
    axes = [k for k, n in enumerate(order) if n is None]
    v = v.transpose([*axes, *(order.index(n) for n, place in enumerate(places) if place is not None)])
    return jnp.expand_dims(v, [own + n for n, place in enumerate(places) if place is None])


def _least(dtype):
    if dtype.kind == "b":
        return np.False_
    return np.array(-np.inf if jnp.issubdtype(dtype, jnp.floating) else jnp.iinfo(dtype).min, dtype)


define(one_loop_p, _mapped, _shapes, _batch, _lower_on_cpu)
