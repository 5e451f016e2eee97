"""Products of one state in C, along what compilers make vectors of."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ._c_loops import affine, blocks, row_major
from ._c_nodes import BITS, INDEX, Node

LEAST = 4  # entries along which a product is worth a vector
_WIDEST = 64  # sums kept at once
_LARGE = 4096  # numbers that are written once, whichever way they are read
_TERMS, _OTHERS = 4, 2  # of a sum, and rows or columns beside each other, at a time


def product(node: Node, writer: Any, entry: Callable[[str], str]) -> list[str]:
    """The statements of a "dot" node: sums along the longer of rows and columns, several terms at a time.

    **Arguments**: `writer`, which knows how operands are read and constants called; `entry`, how an entry of the result
    is written.
    """
    batch, rows, length, columns = node.shape
    A = node.places[0].reshape(batch, rows, length)
    B = node.places[1].reshape(batch, columns, length)
    along_rows = rows >= columns
    X, Y = (A, B) if along_rows else (B, A)
    wide, others = X.shape[1], Y.shape[1]
    x, y = _terms_first(X, writer), writer.reader(Y, Y.shape, False)
    n, lines = ("n", [f"for (int n = 0; n < {batch}; n++) {{"]) if batch > 1 else ("0", ["{"])
    for first, end, m in blocks(wide, _WIDEST):
        lines.append(f"for (int v = {first}; v < {end}; v += {m}) {{")
        for left, right, c in blocks(others, _OTHERS):
            lines.append(f"for (int j = {left}; j < {right}; j += {c}) {{")
            lines.append("R " + ", ".join(f"c{s}[{m}] = {{0}}" for s in range(c)) + ";")
            for start, stop, terms in blocks(length, _TERMS):
                lines.append(f"for (int k = {start}; k < {stop}; k += {terms}) {{")
                pairs = [(s, t) for s in range(c) for t in range(terms)]
                lines.append(
                    "R " + ", ".join(f"y{s}{t} = {y([n, _plus('j', s), _plus('k', t)])}" for s, t in pairs) + ";"
                )
                lines.append(f"for (int i = 0; i < {m}; i++) {{")
                lines.append("R " + ", ".join(f"x{t} = {x([n, _plus('k', t), '(v + i)'])}" for t in range(terms)) + ";")
                sums = (" + ".join(f"x{t} * y{s}{t}" for t in range(terms)) for s in range(c))
                lines.append(" ".join(f"c{s}[i] += {total};" for s, total in enumerate(sums)))
                lines.append("} }")
            at = [("(v + i)", _plus("j", s)) if along_rows else (_plus("j", s), "(v + i)") for s in range(c)]
            where = [affine(0, row_major((batch, rows, columns)), [n, *both]) for both in at]
            stores = " ".join(f"{entry(place)} = c{s}[i];" for s, place in enumerate(where))
            lines.append(f"for (int i = 0; i < {m}; i++) {{ {stores} }}")
            lines.append("}")
        lines.append("}")
    return [*lines, "}"]


def _plus(variable: str, k: int) -> str:
    return f"({variable} + {k})" if k else variable


def _terms_first(X: np.ndarray, writer: Any) -> Callable:
    """A reader of an operand [batch, wide, length] for a batch, a term, and an entry; constants are kept like that."""
    number = int(X.flat[0]) >> BITS if X.flat[0] >= 0 else -1
    source = writer.sources[number] if number >= 0 else None
    if source is None or source.table is None:
        read = writer.reader(X, X.shape, False)
        return lambda variables: read([variables[0], variables[2], variables[1]])
    values = np.ascontiguousarray(source.table.reshape(-1)[X & INDEX].swapaxes(1, 2))
    _, length, wide = values.shape
    if values.size > _LARGE:  # once, though another product reads it across
        across = np.ascontiguousarray(values.swapaxes(1, 2)).tobytes()
        if across in writer.large:
            strides = wide * length, 1, length
            return lambda variables: f"{writer.large[across]}[{affine(0, strides, variables)}]"
        writer.large[values.tobytes()] = writer.table(values)
    name = writer.table(values)
    return lambda variables: f"{name}[{affine(0, row_major(values.shape), variables)}]"
