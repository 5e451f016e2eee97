"""What a batch of a function is taken apart into, and why the rest is not."""

import functools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr

from ._lanes import in_lanes_p, program_of
from ._one_loop import one_loop_p, plan_of
from ._switch import machinery


class Part(NamedTuple):
    """A part of a function that says `one_loop` or `in_lanes`, as it meets it on a CPU.

    `name`, as its code names it, with the class it belongs to; `taken_apart`, whether it becomes one loop, or can be
    written in C; `operations`, of how many scalar operations, 0 if it does not; `reason`, why it does not.
    """

    name: str
    taken_apart: bool
    operations: int
    reason: str


def report(function: Any, *examples: Any, batch: int, in_axes: int | Sequence[Any] | None = 0) -> list[Part]:
    """The parts of `function`, mapped over a batch, that say `one_loop` or `in_lanes`: what becomes of them, and why.

    Nothing is compiled, the machinery counts as on, and the platform as a CPU. What stays outside of any part, is not
    listed; nor what derivatives make of it: they are taken of the mathematics as written.

    **Arguments**: `function`, of one state; `examples`, its arguments for one state, or `jax.ShapeDtypeStruct`;
    `batch`, how many states; `in_axes`, as of `jax.vmap`: None for an argument that is the same for all.
    **Returns** a row for each part, in the order in which they are met.

    >>> from jaxrmp.leaves import Damping
    >>> [(part.name, part.taken_apart) for part in report(Damping().evaluate, np.zeros(7), np.zeros(7), batch=1024)]
    [('Damping.evaluate', True)]
    """
    axes = in_axes if isinstance(in_axes, Sequence) else (in_axes,) * len(examples)

    def widened(x: Any, axis: int) -> jax.ShapeDtypeStruct:
        shape = list(np.shape(x))
        shape.insert(axis, batch)
        return jax.ShapeDtypeStruct(tuple(shape), jax.dtypes.canonicalize_dtype(getattr(x, "dtype", np.result_type(x))))

    pairs = zip(examples, axes, strict=True)
    many = [example if k is None else jax.tree.map(lambda x, k=k: widened(x, k), example) for example, k in pairs]
    with machinery(True):
        closed = jax.make_jaxpr(jax.vmap(function, in_axes=tuple(axes)))(*many)
        return list(_parts(closed.jaxpr))


def _parts(jaxpr: Jaxpr) -> Iterator[Part]:
    for equation in jaxpr.eqns:
        parameters = equation.params
        if equation.primitive is one_loop_p:
            plan = plan_of(parameters["jaxpr"], parameters["levels"], parameters["within"])
            operations = plan.program.operations * max(plan.along, 1) if plan.program else 0
            yield Part(parameters["name"], plan.program is not None, operations, plan.reason)
            continue
        if equation.primitive is in_lanes_p:
            places, reason = parameters["places"], "a single state"
            if places is not None:
                mapped = tuple(place is not None for place in places)
                program, reason = program_of(parameters["jaxpr"], mapped, parameters["name"])
                if program:
                    yield Part(parameters["name"], True, program.operations, "")
                    continue  # as a whole
            yield Part(parameters["name"], False, 0, reason)
            as_usual = functools.partial(in_lanes_p.impl, **parameters)
            yield from _parts(jax.make_jaxpr(as_usual)(*(v.aval for v in equation.invars)).jaxpr)
        else:
            for value in parameters.values():
                for inner in value if isinstance(value, tuple | list) else (value,):
                    if isinstance(inner, ClosedJaxpr | Jaxpr):
                        yield from _parts(inner.jaxpr if isinstance(inner, ClosedJaxpr) else inner)
