"""A function of one state as C that computes several states at once, one in each lane of a vector."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jax.extend.core import ClosedJaxpr

from ._c_parts import taken_apart
from ._c_text import written


class CProgram(NamedTuple):
    """`text`, a C file; `constants`, arguments behind the function's own, shared by all states."""

    text: str
    constants: tuple[np.ndarray, ...]
    operations: int


def c_program(closed: ClosedJaxpr, mapped: Sequence[bool]) -> CProgram:
    """A function as C: `program(const void **in, void **out, long first, long last)`, for states in that range.

    **Arguments**: `closed`, the function of one state; `mapped`, which of its arguments each state has its own of: in
    memory, they have a leading axis of states, as all results do.
    **Raises** `NotScalar` for what it cannot say in C; the message says why.
    """
    program, dtypes, results, real = taken_apart(closed, mapped)
    text = written(program, dtypes, results, real)
    return CProgram(text, tuple(program.constants), sum(math.prod(n.shape) for n in program.nodes))
