"""A function of one state, its arguments and results in the terms of a C program."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jax.extend.core import ClosedJaxpr

from ._c_nodes import sources_of
from ._c_order import needed
from ._c_program import Program
from ._c_types import kind_of
from ._not_scalar import NotScalar


class Parts(NamedTuple):
    """A function taken apart: its `program`; `dtypes` of its arguments and, behind them, of `program.constants`;
    `results`, places and dtype of each; `real`, the type of its numbers."""

    program: Program
    dtypes: list[np.dtype]
    results: list[tuple[np.ndarray, np.dtype]]
    real: np.dtype


def taken_apart(closed: ClosedJaxpr, mapped: Sequence[bool], most: int | None = None) -> Parts:
    """A function of one state as nodes and sources; `mapped`, which of its arguments each state has its own of; `most`,
    steps of a `while`.

    **Raises** `NotScalar` for what cannot be said in C; the message says why.
    """
    values: list[Any] = [*closed.in_avals, *closed.out_avals]
    kinds = {a.dtype for a in values if a.dtype.kind == "f"}
    if len(kinds) != 1 or (real := next(iter(kinds))) not in (np.float32, np.float64):
        raise NotScalar(f"numbers of type {', '.join(sorted(map(str, kinds))) or 'int alone'}")
    if odd := {str(a.dtype) for a in values if not isinstance(a.dtype, np.dtype) or a.dtype.kind not in "bif"}:
        raise NotScalar(f"arrays of type {', '.join(sorted(odd))}")
    program = Program(np.dtype(real), most)
    arguments = []
    for k, a in enumerate(closed.in_avals):
        arguments.append(program.whole(program.source(not mapped[k], kind_of(a.dtype), a.size, k), a.shape))
    program.first_constant = len(arguments)
    outputs = program.run(closed.jaxpr, [program.numbers(c) for c in closed.consts], arguments)
    dtypes = [a.dtype for a in values[: len(arguments)]] + [c.dtype for c in program.constants]
    results = list(zip(outputs, [a.dtype for a in values[len(arguments) :]], strict=True))
    program.nodes = needed(program.nodes, {s for places in outputs for s in sources_of(places)})
    return Parts(program, dtypes, results, np.dtype(real))
