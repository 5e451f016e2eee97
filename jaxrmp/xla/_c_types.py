"""Which types of numbers a program in C holds: those of one precision, whole numbers of the same size, and truth."""

from typing import Any

import numpy as np

from ._not_scalar import NotScalar
from ._scalar_program import MOVES

# Truth is all bits set or none, whose order is not that of numbers.
_OF_NUMBERS = frozenset(
    "add add_any sub mul neg max min reduce_max reduce_min reduce_sum lt le gt ge clamp sign abs".split()  # noqa: SIM905
)
_KINDS = {"f": "f", "i": "i", "u": "i", "b": "i"}
# Of what they are made of, each is looked at on its own; and what moves entries about does not compute.
_OF_OTHERS = frozenset(("jit", "pjit", "custom_jvp_call", "custom_vjp_call", "one_loop", "in_lanes"))
# Where smaller whole numbers give the same as larger ones: counts, and what stands for truth.
_WHOLE = frozenset("add sub reduce_sum max min eq ne lt le gt ge select_n convert_element_type".split())  # noqa: SIM905


def kind_of(dtype: Any) -> str:
    """The kind of a source: "f" or "i"."""
    if (kind := np.dtype(dtype).kind) not in _KINDS:
        raise NotScalar(f"holds numbers of type {dtype}")
    return _KINDS[kind]


def check_types(equation: Any, known: list[bool], real: np.dtype, whole: np.dtype) -> None:
    """**Raises** `NotScalar` for an equation of types that a program of `real` and `whole` numbers does not have.

    `known`, which of its operands are numbers that are known: they may be of any type.
    """
    name = equation.primitive.name
    values = [v.aval.dtype for v, is_known in zip(equation.invars, known, strict=True) if not is_known]
    if name not in MOVES and name not in _OF_OTHERS and values:
        fine = [real, whole, np.dtype(bool)]
        if name in _WHOLE and not (name == "convert_element_type" and values[0].kind == "f"):
            fine.append(np.dtype(np.int32))
        if odd := {str(t) for t in (*values, *(v.aval.dtype for v in equation.outvars)) if t not in fine}:
            raise NotScalar(f"holds `{name}` of {', '.join(sorted(odd))} among numbers of type {real}")
    truth = [v.aval.dtype.kind == "b" for v in equation.invars]
    if (name in _OF_NUMBERS and any(truth)) or (name == "select_n" and (not truth[0] or len(truth) != 3)):
        raise NotScalar(f"holds `{name}` of {', '.join(str(v.aval.dtype) for v in equation.invars)}")
