"""Products of one state in C, along what compilers make vectors of."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ._c_loops import affine, blocks, row_major
from ._c_nodes import BITS, INDEX, Node

LEAST = 4  # entries along which a product is worth a vector
LANES = 16  # sums of one, along its terms
_WIDEST = 64  # sums kept at once
_LARGE = 4096  # numbers that are written once, whichever way they are read
_TERMS, _OTHERS = 4, 2  # of a sum, and rows or columns beside each other, at a time


def product(node: Node, writer: Any, entry: Callable[[str], str]) -> list[str]:
    """The statements of a "dot" node, along the longest of its axes.

    **Arguments**: `writer`, which knows how operands are read and constants called; `entry`, how an entry of the result
    is written.
    """
    _, rows, length, columns = node.shape
    if node.settings.get("batch") == "last":
        return _along_batch(node, writer, entry)
    if max(rows, columns) < LEAST <= length // LANES:
        return _along_terms(node, writer, entry)
    return _along_results(node, writer, entry)


def _along_results(node: Node, writer: Any, entry: Callable[[str], str]) -> list[str]:
    """Along the longer of rows and columns, several terms at a time."""
    batch, rows, length, columns = node.shape
    A = node.places[0].reshape(batch, rows, length)
    B = node.places[1].reshape(batch, columns, length)
    along_rows = rows >= columns
    X, Y = (A, B) if along_rows else (B, A)
    wide, others = X.shape[1], Y.shape[1]
    (x, more), y = _terms_first(X, writer), writer.reader(Y, Y.shape, False)
    n, lines = ("n", [f"for (int n = 0; n < {batch}; n++) {{"]) if batch > 1 else ("0", ["{"])
    for first, end, m in blocks(wide, _WIDEST):
        padded = more if end == wide and first + m == end else 0
        lines.append(f"for (int v = {first}; v < {end}; v += {m}) {{")
        for left, right, c in blocks(others, _OTHERS):
            lines.append(f"for (int j = {left}; j < {right}; j += {c}) {{")
            lines.append("R " + ", ".join(f"c{s}[{m + padded}] = {{0}}" for s in range(c)) + ";")
            for start, stop, terms in blocks(length, _TERMS):
                lines.append(f"for (int k = {start}; k < {stop}; k += {terms}) {{")
                pairs = [(s, t) for s in range(c) for t in range(terms)]
                lines.append(
                    "R " + ", ".join(f"y{s}{t} = {y([n, _plus('j', s), _plus('k', t)])}" for s, t in pairs) + ";"
                )
                lines.append(f"for (int i = 0; i < {m + padded}; i++) {{")
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


def _along_batch(node: Node, writer: Any, entry: Callable[[str], str]) -> list[str]:
    """Along many small products, of which the result holds the same entry of all next to each other."""
    batch, rows, length, columns = node.shape
    a, b = (
        _batch_last(places.reshape(batch, size, length).transpose(1, 2, 0), writer)
        for places, size in zip(node.places, (rows, columns), strict=True)
    )
    lines = [f"for (int i = 0; i < {rows}; i++) {{", f"for (int j = 0; j < {columns}; j++) {{"]
    for first, end, m in blocks(batch, _WIDEST):
        lines += [f"for (int v = {first}; v < {end}; v += {m}) {{", f"R c[{m}] = {{0}};"]
        for start, stop, terms in blocks(length, _TERMS):
            lines.append(f"for (int k = {start}; k < {stop}; k += {terms}) {{ for (int n = 0; n < {m}; n++) {{")
            at = [(_plus("k", t), "(v + n)") for t in range(terms)]
            lines.append("c[n] += " + " + ".join(f"{a(['i', *where])} * {b(['j', *where])}" for where in at) + ";")
            lines.append("} }")
        where = affine(0, row_major((rows, columns, batch)), ["i", "j", "(v + n)"])
        lines += [f"for (int n = 0; n < {m}; n++) {{ {entry(where)} = c[n]; }}", "}"]
    return [*lines, "} }"]


def _along_terms(node: Node, writer: Any, entry: Callable[[str], str]) -> list[str]:
    """Along the terms of few sums: each as many sums as a vector has entries, which are added at last."""
    batch, rows, length, columns = node.shape
    A, B = node.places
    a, b = writer.reader(A, (batch, rows, length), False), writer.reader(B, (batch, columns, length), False)
    n, lines = ("n", [f"for (int n = 0; n < {batch}; n++) {{"]) if batch > 1 else ("0", ["{"])
    pairs = [(r, s) for r in range(rows) for s in range(columns)]
    lines.append("R " + ", ".join(f"c{r}{s}[{LANES}] = {{0}}" for r, s in pairs) + ";")
    for first, end, m in blocks(length, LANES):
        lines.append(f"for (int k = {first}; k < {end}; k += {m}) {{ for (int l = 0; l < {m}; l++) {{")
        of_rows = [f"a{r} = {a([n, str(r), '(k + l)'])}" for r in range(rows)]
        of_columns = [f"b{s} = {b([n, str(s), '(k + l)'])}" for s in range(columns)]
        lines += [f"R {', '.join(of_rows + of_columns)};", " ".join(f"c{r}{s}[l] += a{r} * b{s};" for r, s in pairs)]
        lines.append("} }")
    names = [f"c{r}{s}" for r, s in pairs]
    lines += added(names, "{0} + {1}")
    where = (affine(0, row_major((batch, rows, columns)), [n, str(r), str(s)]) for r, s in pairs)
    lines += [f"{entry(place)} = {name}[0];" for name, place in zip(names, where, strict=True)]
    return [*lines, "}"]


def added(names: Sequence[str], fold: str) -> list[str]:
    """Statements that bring each of some arrays, of `LANES` entries, into its first by a `fold` of two at a time."""
    lines, half = [], LANES // 2
    while half:
        both = " ".join(f"{name}[l] = {fold.format(f'{name}[l]', f'{name}[l + {half}]')};" for name in names)
        lines.append(f"for (int l = 0; l < {half}; l++) {{ {both} }}")
        half //= 2
    return lines


def _plus(variable: str, k: int) -> str:
    return f"({variable} + {k})" if k else variable


def _constants(X: np.ndarray, writer: Any) -> np.ndarray | None:
    """The numbers of an operand, if it is one of constants."""
    number = int(X.flat[0]) >> BITS if X.flat[0] >= 0 else -1
    table = writer.sources[number].table if number >= 0 else None
    return None if table is None else table.reshape(-1)[X & INDEX]


def _batch_last(X: np.ndarray, writer: Any) -> Callable:
    """A reader of an operand in the order in which its places are; constants are kept like that."""
    values = _constants(X, writer)
    if values is None:
        return writer.reader(X, X.shape, False)
    name = writer.table(np.ascontiguousarray(values))
    return lambda variables: f"{name}[{affine(0, row_major(values.shape), variables)}]"


def _terms_first(X: np.ndarray, writer: Any) -> tuple[Callable, int]:
    """A reader of an operand [batch, wide, length] for a batch, a term, and an entry; constants are kept like that,
    those of one that is small with so many zeros more of entries that they fill vectors."""
    values = _constants(X, writer)
    if values is None:
        read = writer.reader(X, X.shape, False)
        return (lambda variables: read([variables[0], variables[2], variables[1]])), 0
    values = np.ascontiguousarray(values.swapaxes(1, 2))
    _, length, wide = values.shape
    more = 0
    if values.size > _LARGE:  # once, though another product reads it across
        across = np.ascontiguousarray(values.swapaxes(1, 2)).tobytes()
        if across in writer.large:
            strides = wide * length, 1, length
            return (lambda variables: f"{writer.large[across]}[{affine(0, strides, variables)}]"), 0
        writer.large[values.tobytes()] = writer.table(values)
    elif wide > LEAST:
        more = -wide % 8
        values = np.pad(values, ((0, 0), (0, 0), (0, more)))
    name = writer.table(values)
    return (lambda variables: f"{name}[{affine(0, row_major(values.shape), variables)}]"), more
