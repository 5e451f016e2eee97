"""A function of one state taken apart into what C programs are made of.

Small arrays are taken apart into scalars, as for XLA (`_scalar_program.py`), and become single statements, which share
what is equal and leave out what is zero; large ones become loops, neighbours of one shape a single loop. What moves
entries about is no code at all: every array is a table of places where its entries are. What depends on no state of the
batch is computed once.
"""

import math
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr

from ._c_gather import gathered
from ._c_nodes import BITS, INDEX, Node, Source, is_elementwise, sources_of
from ._c_once import constant, repeated
from ._c_scan import scanned
from ._c_types import check_types, kind_of
from ._c_while import looped
from ._elementwise import in_known_operations
from ._not_scalar import NotScalar, UnknownOperation
from ._rows import matrices, rows_over
from ._scalar_program import ELEMENTWISE, Builder, Operation, coordinate_program

_LEAST = 4  # coordinates from which on a loop is worth it
_SMALL = 16  # entries of an array that is taken apart, and operations of a product or a sum
_FLAT_MOST = 3000
_MANY = 16  # products that are computed along each other
_BLOCKS = 64  # of a product with zeros
_UNTOLD = np.iinfo(np.int64).min
_MOST_SINGLE = 20000  # statements: compilers take more than proportionally long
_MOST_KNOWN, _MOST_WRITTEN = 65536, 1024  # numbers of a constant whose values are looked at, and that are written out
_OF_NOTHING = {
    "reduce_sum": 0,
    "reduce_max": -np.inf,
    "reduce_min": np.inf,
    "reduce_and": True,
    "reduce_or": False,
}


class Program(Builder):
    """Takes a function apart; a place is a number, negative for a number that is known.

    `real`, the type of its numbers; whole numbers have the same size; `most`, steps of a `while`, where stated.
    """

    def __init__(self, real: np.dtype, most: int | None = None):
        super().__init__()
        self.most = most
        self.real, self.whole_number = real, np.dtype(f"i{real.itemsize}")
        self.sources: list[Source] = []
        self.nodes: list[Node] = []
        self.constants: list[np.ndarray] = []
        self.first_constant = 0
        self._numbers: list[np.generic] = []
        self._number_places: dict[Any, int] = {}
        self._made: dict[int, Operation] = {}
        self._tables: dict[Any, np.ndarray] = {}
        self._small = _SMALL
        self._whole = 0  # within functions that are taken apart as a whole
        self.single_steps = 0

    # Places

    def source(self, *fields, **more) -> int:
        found = Source(*fields, **more)
        if found.size > INDEX:
            raise NotScalar(f"an array of {found.size:,} entries")
        self.sources.append(found)
        return len(self.sources) - 1

    def whole(self, source: int, shape: Sequence[int]) -> np.ndarray:
        return ((source << BITS) + np.arange(math.prod(shape), dtype=np.int64)).reshape(shape)

    def number(self, value: np.generic) -> int:
        key = (value.dtype, value.tobytes())
        if key not in self._number_places:
            self._numbers.append(value)
            self._number_places[key] = -len(self._numbers)
        return self._number_places[key]

    def known(self, place: int) -> np.generic:
        return self._numbers[-1 - place]

    def numbers(self, value: Any, dtype: Any = None) -> np.ndarray:
        value = np.asarray(value, dtype)
        flat = value.reshape(-1)
        if value.size > _MOST_KNOWN and not (flat == flat[0]).all():
            return self._constant(value)
        places = [self.number(value.dtype.type(x)) for x in flat]
        return np.array(places, dtype=np.int64).reshape(value.shape)

    def _constant(self, value: np.ndarray) -> np.ndarray:
        """An argument of numbers that are too many for the program's text."""
        self.constants.append(value)
        k = self.first_constant + len(self.constants) - 1
        return self.whole(self.source(True, kind_of(value.dtype), value.size, k), value.shape)

    def table(self, places: np.ndarray) -> np.ndarray:
        """Numbers that differ, as entries of a constant array."""
        key = places.tobytes()
        if key not in self._tables:
            values = np.array([self.known(p) for p in places.reshape(-1)])
            if values.size > _MOST_WRITTEN:
                self._tables[key] = self._constant(values)
            else:
                found = self.source(True, kind_of(values.dtype), values.size, table=values)
                self._tables[key] = self.whole(found, (values.size,))
        return self._tables[key].reshape(places.shape)

    def is_shared(self, *places: np.ndarray) -> bool:
        return all(self.sources[s].shared for p in places for s in sources_of(p))

    # What Builder asks for

    def step(self, step: Any) -> int:
        key = (step[:2], tuple(x if isinstance(x, int) else x.tobytes() for x in step.operands), step.dtype)
        if key not in self._places:
            self.single_steps += 1
            if self._whole and self.single_steps > self._whole:
                raise NotScalar(f"more than {_FLAT_MOST:,} operations")
            if self.single_steps > _MOST_SINGLE:
                raise NotScalar(f"more than {_MOST_SINGLE:,} operations on single numbers")
            codes = tuple(np.array(x if isinstance(x, int) else self.number(x), dtype=np.int64) for x in step.operands)
            name = _supported(step.primitive.name, step.dtype)
            out = self.source(self.is_shared(*codes), kind_of(step.dtype), 1, single=True)
            self.nodes.append(Node(out, name, dict(step.parameters), codes, ()))
            self._places[key] = out << BITS
            self._made[out << BITS] = step
        return self._places[key]

    def made(self, place: int) -> Any:
        return self._made.get(place)

    def _equation(self, equation, operands):
        try:
            return self._of(equation, operands)
        except NotScalar as error:
            error.within.append(equation)
            raise

    def _of(self, equation, operands):
        name, parameters = equation.primitive.name, equation.params
        if name == "one_loop" and not parameters["levels"]:
            return self._of_a_loop(parameters["jaxpr"], operands)
        if name == "in_lanes" and parameters["places"] is None:
            return self.run(parameters["jaxpr"].jaxpr, [self.numbers(c) for c in parameters["jaxpr"].consts], operands)
        if name == "gather":
            if (operands[1] >= 0).any():
                raise NotScalar("holds `gather` by indices that are computed")
            starts = np.array([self.known(p) for p in operands[1].reshape(-1)], dtype=int).reshape(operands[1].shape)
            return [gathered(parameters, operands[0], starts)]
        if name == "scan":
            return scanned(self, parameters, operands)
        if name == "while":
            return looped(self, parameters, operands)
        types = [v.aval.dtype for v in (*equation.invars, *equation.outvars)]
        if name == "convert_element_type" and (operands[0] < 0).all():
            known = [self.known(p) for p in operands[0].reshape(-1)]
            return [self.numbers(known, types[1]).reshape(operands[0].shape)]
        check_types(equation, [bool((x < 0).all()) for x in operands], self.real, self.whole_number)
        if name == "convert_element_type":
            return [self._converted(equation.primitive, operands[0], *types)]
        return super()._equation(equation, operands)

    def _unknown(self, equation, operands):
        found = in_known_operations(equation)
        if found is None:
            raise UnknownOperation(equation.primitive.name)
        return self.run(found.jaxpr, [self.numbers(c) for c in found.consts], operands)

    def _converted(self, primitive, places, old, new) -> np.ndarray:
        if old == new:
            return places
        # Only kinds matter: there is one type of each in a program.
        return self._each(primitive, (("new", new.kind), ("old", old.kind)), (places,), places.shape, new)

    def _of_a_loop(self, closed: ClosedJaxpr, operands) -> list[np.ndarray]:
        """As scalars if they are few, shared and simplified; else as it stands."""
        try:
            if not self._whole and coordinate_program(closed)[1] >= _LEAST:
                return self._by_coordinates(closed, operands)
        except NotScalar:
            pass
        outside, steps = self._whole, self.single_steps
        arguments = [self.numbers(c) for c in closed.consts], operands
        try:
            self._whole = outside or steps + _FLAT_MOST
            return self.run(closed.jaxpr, *arguments)
        except NotScalar:
            if outside:
                raise
            self.single_steps, self._whole = steps, 0  # what was tried is left out at the end, as all that is not used
            return self.run(closed.jaxpr, *arguments)
        finally:
            self._whole = outside

    def _by_coordinates(self, closed, operands):
        self._small, outside = 1, self._small
        try:
            return self.run(closed.jaxpr, [self.numbers(c) for c in closed.consts], operands)
        finally:
            self._small = outside

    def _each(self, primitive, parameters, operands, shape, dtype):
        spread = [np.broadcast_to(x, shape) for x in operands]
        size = math.prod(shape)
        if size <= self._small or self._whole:
            return self.entries([self.one(primitive, parameters, x, dtype) for x in _rows(spread)], shape)
        if all(constant(x) for x in spread):  # the same everywhere
            return np.full(shape, self.one(primitive, parameters, [int(x.flat[0]) for x in spread], dtype))
        if all((x < 0).all() for x in spread):
            found = [self.one(primitive, parameters, x, dtype) for x in _rows(spread)]
            return self.entries(found, shape)
        name = primitive.name
        if name == "integer_pow" and dict(parameters)["y"] == 0:
            return np.full(shape, self.one(primitive, parameters, (), dtype))
        told = self._told(name, spread, dtype)
        if told is not None and 4 * np.count_nonzero(rest := told == _UNTOLD) <= 3 * size:
            told[rest] = self._each(primitive, parameters, [x[rest] for x in spread], (int(rest.sum()),), dtype)
            return told
        if name == "square" or (name == "integer_pow" and dict(parameters)["y"] == 2):
            name, parameters, spread = "mul", (), [spread[0], spread[0]]
        name = _supported(name, dtype)
        if (once := repeated(spread)) is not None:
            first, where = once
            few = [x.reshape(-1)[first] for x in spread]
            return self._each(primitive, parameters, few, first.shape, dtype)[where].reshape(shape)
        return self._array(name, parameters, spread, shape, dtype, size)

    def _told(self, name, spread, dtype) -> np.ndarray | None:
        """Entries that need no computing: of products with zeros and ones, sums with zeros, choices that are made."""
        if all((x >= 0).all() for x in spread):
            return None
        told = np.full(spread[0].shape, _UNTOLD)
        if name == "select_n":
            known, which = spread[0] < 0, spread[0] == self.number(np.bool_(True))
            told[known] = np.where(which, spread[2], spread[1])[known]
            return told
        if name not in ("mul", "div", "add", "add_any", "sub"):
            return None
        zero = self.number(np.dtype(dtype).type(0))
        neutral = self.number(np.dtype(dtype).type(1)) if name in ("mul", "div") else zero
        a, b = spread
        told = np.where(b == neutral, a, told)
        if name not in ("sub", "div"):
            told = np.where(a == neutral, b, told)
        if name in ("mul", "div"):
            told = np.where((a == zero) | ((b == zero) & (name == "mul")), zero, told)
        return told

    def one(self, primitive, parameters, entries, dtype) -> int:
        if primitive.name == "integer_pow" and dict(parameters)["y"] == 0:
            return self.number(np.dtype(dtype).type(1))
        operands = tuple(int(p) if p >= 0 else self.known(int(p)) for p in entries)
        found = self.operation(primitive, parameters, operands, dtype)
        return found if isinstance(found, int) else self.number(found)

    def entries(self, values, shape):
        return np.array(values, dtype=np.int64).reshape(shape)

    def _in_memory(self, places: np.ndarray) -> np.ndarray:
        """The same entries, from one source each that a loop can run over."""
        if (places < 0).all():
            return places if constant(places) else self.table(places)
        used = np.unique(places >> BITS)
        if (places >= 0).all() and len(used) == 1:
            return places
        kind = self.sources[int(places[places >= 0].flat[0]) >> BITS].kind
        distinct, first, where = np.unique(places, return_index=True, return_inverse=True)
        if 4 * len(distinct) <= places.size:  # each once, in the order in which they come
            order = np.argsort(first)
            kept = self._in_memory(distinct[order])
            return kept[np.argsort(order)[where]].reshape(places.shape)
        return self._array("copy", (), (places,), places.shape, kind, places.size).reshape(places.shape)

    def _array(self, op, parameters, operands, shape, dtype, size) -> np.ndarray:
        """An array of `size` entries that a node makes, unless there is one that makes the same."""
        longest = int(np.argmax(shape)) if is_elementwise(op) else len(shape) - 1
        if shape[longest] > shape[-1]:  # last, along which loops run
            moved = [np.moveaxis(p, longest, -1) for p in operands]
            found = self._array(op, parameters, moved, moved[0].shape, dtype, size)
            return np.moveaxis(found, -1, longest)
        places = operands if op == "copy" else tuple(map(self._in_memory, operands))
        key = (op, parameters, shape, *(p.tobytes() for p in places), *(p.shape for p in places))
        if key not in self._tables:
            out = self.source(self.is_shared(*places), dtype if op == "copy" else kind_of(dtype), size)
            self.nodes.append(Node(out, op, dict(parameters), places, shape))
            self._tables[key] = self.whole(out, (size,))
        return self._tables[key].reshape(shape if len(shape) and math.prod(shape) == size else (size,))

    def _dot(self, parameters, a, b, dtype):
        A, B, shape = matrices(parameters, a, b)
        size, k = math.prod(shape), A.shape[-1]
        if size * k <= 4 * _SMALL or self._whole:
            if size * k > _FLAT_MOST:
                raise NotScalar(f"a product of more than {_FLAT_MOST:,} operations")
            return self.product(A, B, shape, dtype)
        few = self._of_few_terms(A, B, shape, dtype)
        if few is None:
            few = self._of_few_terms(B, A, shape, dtype, swapped=True)
        if few is not None:
            return few
        return self._by_blocks(A, B, dtype).reshape(shape)

    def _by_blocks(self, A, B, dtype) -> np.ndarray:
        """A product [b, m, k] by [b, n, k], over k, in blocks of rows and columns that have their zeros in common."""
        shape = len(A), A.shape[1], B.shape[1]
        if math.prod(shape) * A.shape[-1] <= 4 * _SMALL:
            return self.product(A, B, shape, dtype)
        zero = self.number(np.dtype(dtype).type(0))
        (rows, row_of), (columns, column_of) = (
            np.unique((zero != X).any(axis=0), axis=0, return_inverse=True) for X in (A, B)
        )
        terms = (rows[:, None] & columns)[row_of][:, column_of].sum()
        if 4 * terms > 3 * math.prod(A.shape[1:]) * B.shape[1] or len(rows) * len(columns) > _BLOCKS:
            if A.shape[1] > B.shape[1]:  # the longer of them last, along which loops run
                return self._by_blocks(B, A, dtype).swapaxes(1, 2)
            whole, size = (*A.shape, B.shape[1]), math.prod(shape)
            if len(A) > max(_MANY, *shape[1:]):
                A, B = (np.moveaxis(self._in_memory(np.moveaxis(X, 0, -1)), -1, 0) for X in (A, B))
                found = self._array("dot", (("batch", "last"),), (A, B), whole, dtype, size)
                return np.moveaxis(found.reshape(*shape[1:], len(A)), -1, 0)
            B = self._in_memory(B.swapaxes(1, 2)).swapaxes(1, 2)
            return self._array("dot", (), (A, B), whole, dtype, size).reshape(shape)
        found = np.full(shape, zero)
        for i, j in np.ndindex(len(rows), len(columns)):
            if (both := rows[i] & columns[j]).any():
                at, across = row_of == i, column_of == j
                made = self._by_blocks(A[:, at][..., both], B[:, across][..., both], dtype)
                found[np.ix_(range(len(A)), at, across)] = made.reshape(len(A), at.sum(), -1)
        return found

    def _of_few_terms(self, A, B, shape, dtype, swapped=False):
        """A product with numbers of which at most two in a row are not zero: entries, or sums of two."""
        if B.shape[0] != 1 or not (B < 0).all():
            return None
        values = np.array([self.known(p) for p in B.reshape(-1)]).reshape(B.shape[1:])
        terms = [np.flatnonzero(row) for row in values]
        most = max(map(len, terms), default=0)
        if most > 2 or min(map(len, terms), default=0) < most or not most:
            return None
        total: Any = None
        for t in range(most):
            chosen = [row[t] for row in terms]
            part = A[0][:, chosen]
            scale = np.array([self.number(values[j, k]) for j, k in enumerate(chosen)], dtype=np.int64)
            part, scale = (part.T, scale[:, None]) if swapped else (part, scale[None])
            part = self._each(jax.lax.mul_p, (), (part, np.broadcast_to(scale, part.shape)), part.shape, dtype)
            total = part if total is None else self._each(jax.lax.add_p, (), (total, part), part.shape, dtype)
        return total.reshape(shape)

    def _reduced(self, name, axes, a, shape, dtype):
        rows = rows_over(a, axes)
        if not rows.shape[1]:
            if np.dtype(dtype).kind == "i" and name != "reduce_sum":
                raise NotScalar(f"`{name}` of nothing")
            return np.broadcast_to(self.numbers(_OF_NOTHING[name], dtype), shape)
        if rows.size <= _SMALL or self._whole:
            return super()._reduced(name, axes, a, shape, dtype)
        return self._array("reduce", (("by", name),), (rows,), rows.shape, dtype, len(rows)).reshape(shape)


def _rows(spread):
    return zip(*(x.reshape(-1).tolist() for x in spread), strict=True)


def _supported(name: str, dtype: Any) -> str:
    if name not in ELEMENTWISE:
        raise NotScalar(f"holds `{name}`")
    if name in ("div", "rem", "pow", "integer_pow", "sign") and np.dtype(dtype).kind != "f":
        raise NotScalar(f"holds `{name}` of whole numbers")
    return name
