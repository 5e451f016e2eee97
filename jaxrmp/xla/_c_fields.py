"""Fields of the structs that a function in C takes and gives."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ._c_text import c_type


class Field(NamedTuple):
    """A field of a struct by its `name`: an array of some `shape` and `dtype`, row by row, and a `note` of what it is.

    One without entries is left out of the struct.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype
    note: str = ""

    @property
    def size(self) -> int:
        """How many entries it has."""
        return math.prod(self.shape)


def struct(name: str, fields: Sequence[Field]) -> str:
    """The struct `name` of these `fields`, in C, with their shapes and notes as comments."""
    lines = ["typedef struct {"]
    for field in fields:
        if field.size:
            size = f"[{field.size}]" if field.shape else ""
            shape = f"[{', '.join(map(str, field.shape))}]" if len(field.shape) > 1 else ""
            note = ", ".join(text for text in (shape, field.note) if text)
            lines.append(f"    {c_type(field.dtype)} {field.name}{size};" + (f" /* {note} */" if note else ""))
    return "\n".join([*lines, f"}} {name};"])


def layout(fields: Sequence[Field]) -> np.dtype:
    """How NumPy sees the struct of these `fields`."""
    return np.dtype([(f.name, f.dtype, f.shape) for f in fields if f.size], align=True)


HIT = Field("bound_hit", (), np.dtype(np.int32), "loops that were cut off at the count stated for them; 0: none")
