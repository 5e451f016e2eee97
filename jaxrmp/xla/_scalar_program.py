"""A function of small arrays as a list of scalar operations."""

import functools
import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

from ._elementwise import is_elementwise
from ._not_scalar import NotScalar
from ._rows import matrices, rows_over

# XLA recurses along chains of dependent operations, and LLVM does not vectorise loops of twice this size.
_MOST, _DEEPEST = 3000, 500
_MOST_RESULTS = 200
_INLINED = {"jit": "jaxpr", "pjit": "jaxpr", "custom_jvp_call": "call_jaxpr", "custom_vjp_call": "call_jaxpr"}
ELEMENTWISE = frozenset(
    "abs acos acosh add add_any and asin asinh atan atan2 atanh cbrt ceil clamp convert_element_type cos cosh div eq "  # noqa: SIM905
    "erf exp exp2 expm1 floor ge gt integer_pow is_finite le log log1p logistic lt max min mul ne neg not "
    "or pow rem round rsqrt select_n sign sin sinh sqrt square sub tan tanh xor".split()
)
REDUCTIONS = {
    "reduce_sum": jax.lax.add_p,
    "reduce_max": jax.lax.max_p,
    "reduce_min": jax.lax.min_p,
    "reduce_and": jax.lax.and_p,
    "reduce_or": jax.lax.or_p,
}
_KNOWN: dict[str, Callable] = {
    **{name: getattr(operator, name) for name in ("add", "mul", "sub", "neg", "eq", "ne", "lt", "le", "gt", "ge")},
    **{"and": np.bitwise_and, "or": np.bitwise_or, "not": np.invert},
}
Number = np.generic


class Operation(NamedTuple):
    """A JAX primitive on scalars: each the place of an earlier operation or input, or a number."""

    primitive: Any
    parameters: tuple[tuple[str, Any], ...]
    operands: tuple["int | Number", ...]
    dtype: np.dtype


class Input(NamedTuple):
    """An entry of an argument: the argument's place, and the entry's in it, row by row."""

    argument: int
    entry: int
    dtype: np.dtype


class ScalarProgram(NamedTuple):
    """`steps`, each an input or an operation on what is above it, and for each output its entries: steps or numbers.

    `constants` are arguments behind the function's own.
    """

    steps: list[Input | Operation]
    outputs: list[np.ndarray]
    constants: tuple[np.ndarray, ...] = ()

    @property
    def operations(self) -> int:
        """How many scalar operations there are."""
        return sum(isinstance(step, Operation) for step in self.steps)

    def computes(self, entry: "int | Number") -> bool:
        """Whether an entry of an output is neither a number nor an entry of an argument as it came."""
        return isinstance(entry, int) and isinstance(self.steps[entry], Operation)

    def evaluate(
        self, of_input: Callable[[Input], Any], of_number: Callable[[Number], Any]
    ) -> Callable[["int | Number"], Any]:
        """All steps by JAX, on arrays of one shape; what they give, by their place."""
        values: list[Any] = []

        def value(entry):
            return values[entry] if isinstance(entry, int) else of_number(entry)

        for step in self.steps:
            if isinstance(step, Input):
                values.append(of_input(step))
            else:
                values.append(step.primitive.bind(*(value(x) for x in step.operands), **dict(step.parameters)))
        return value


def scalar_program(closed: ClosedJaxpr) -> ScalarProgram:
    """Take a function apart. **Raises** `NotScalar` if it is too large, or holds what is not arithmetic."""
    results: Sequence[Any] = closed.out_avals
    count = sum(a.size for a in results)
    if count > _MOST_RESULTS:
        raise NotScalar(f"too many results ({count:,} > {_MOST_RESULTS})")
    if any(a.dtype.kind not in "biuf" for a in results):
        raise NotScalar(f"results of type {', '.join(str(a.dtype) for a in results if a.dtype.kind not in 'biuf')}")
    builder = Builder()
    arguments = []
    values: Sequence[Any] = closed.in_avals
    for k, a in enumerate(values):
        arguments.append(entries([builder.step(Input(k, i, a.dtype)) for i in range(a.size)], a.shape))
    outputs = builder.run(closed.jaxpr, [builder.numbers(c) for c in closed.consts], arguments)
    return _only_needed(builder.steps, outputs)


def coordinate_program(closed: ClosedJaxpr) -> tuple[ScalarProgram, int]:
    """The program for one coordinate of a function of vectors of one length, elementwise throughout; and that length.

    **Raises** `NotScalar` for any other function.
    """
    lengths = {a.shape for a in closed.out_avals}
    if len(lengths) != 1 or len(length := next(iter(lengths))) != 1:
        raise NotScalar("results that are not vectors of one length")
    builder = _Coordinate(length)
    arguments = []
    for k, a in enumerate(closed.in_avals):
        arguments.append(entries([builder.step(Input(k, 0, a.dtype))], builder.thin(a.shape)))
    builder.first_constant = len(arguments)
    outputs = builder.run(closed.jaxpr, [builder.numbers(c) for c in closed.consts], arguments)
    program = _only_needed(builder.steps, [o.reshape(()) for o in outputs])
    return program._replace(constants=tuple(builder.constants)), length[0]


def entries(values: Sequence[Any], shape: tuple[int, ...]) -> np.ndarray:
    """Places and numbers as an array of objects."""
    found = np.empty(len(values), object)
    for i, value in enumerate(values):  # one by one: NumPy would make numbers of one type of them
        found[i] = value
    return found.reshape(shape)


class Builder:
    """Walks through a function's operations, and adds each of theirs on scalars as a step."""

    def __init__(self):
        self.steps: list[Input | Operation] = []
        self._depths: list[int] = []
        self._places: dict[Any, int] = {}

    def step(self, step: Input | Operation) -> int:
        """The place of a step, which is added unless it is there."""
        operands: tuple[Any, ...] = step.operands if isinstance(step, Operation) else ()
        # Numbers by their bits: 0.0 and -0.0 are equal.
        key = (step[:2], tuple(x if isinstance(x, int) else x.tobytes() for x in operands), step.dtype)
        if key in self._places:
            return self._places[key]
        depth = 1 + max((self._depths[x] for x in operands if isinstance(x, int)), default=0)
        if len(self.steps) >= _MOST:
            raise NotScalar(f"more than {_MOST:,} operations")
        if depth > _DEEPEST:
            raise NotScalar(f"a chain of more than {_DEEPEST} operations")
        self._places[key] = len(self.steps)
        self.steps.append(step)
        self._depths.append(depth)
        return self._places[key]

    def made(self, place: int) -> Any:
        """What was added at a place."""
        return self.steps[place]

    def numbers(self, value: Any, dtype: Any = None) -> np.ndarray:
        value = np.asarray(value, dtype)
        if value.size > _MOST:
            raise NotScalar(f"more than {_MOST:,} numbers in an array")
        return entries([value.dtype.type(x) for x in value.reshape(-1)], value.shape)

    def run(self, jaxpr: Jaxpr, consts: Sequence[np.ndarray], arguments: Sequence[np.ndarray]) -> list[np.ndarray]:
        found: dict[Any, np.ndarray] = dict(zip(jaxpr.constvars, consts, strict=True))
        found.update(zip(jaxpr.invars, arguments, strict=True))

        def read(v: Any) -> np.ndarray:
            if isinstance(v, Literal):
                aval: Any = v.aval
                return self.numbers(v.val, aval.dtype)
            return found[v]

        for equation in jaxpr.eqns:
            outputs = self._equation(equation, [read(v) for v in equation.invars])
            found.update(zip(equation.outvars, outputs, strict=True))
        return [read(v) for v in jaxpr.outvars]

    def one(self, primitive: Any, parameters: tuple, entries: Any, dtype: Any) -> Any:
        """An operation on entries, as an entry."""
        return self.operation(primitive, parameters, entries, dtype)

    def entries(self, values: Sequence[Any], shape: tuple[int, ...]) -> np.ndarray:
        """An array of entries."""
        return entries(values, shape)

    def _equation(self, equation, operands: list[np.ndarray]) -> list[np.ndarray]:
        name, parameters = equation.primitive.name, equation.params
        if name in _INLINED:
            inner = parameters[_INLINED[name]]
            return self.run(inner.jaxpr, [self.numbers(c) for c in inner.consts], operands)
        if name in ("one_loop", "in_lanes"):
            mapped = functools.partial(equation.primitive.impl, **parameters)
            inner = jax.make_jaxpr(mapped)(*(v.aval for v in equation.invars))
            return self.run(inner.jaxpr, [self.numbers(c) for c in inner.consts], operands)
        if name in _AS_IT_IS:
            return operands
        if name in MOVES:
            return MOVES[name](parameters, *operands)
        shape, dtype = equation.outvars[0].aval.shape, equation.outvars[0].aval.dtype
        if name == "iota":
            size, k = shape, parameters["dimension"]
            along = np.arange(size[k]).reshape([-1 if i == k else 1 for i in range(len(size))])
            return [self.numbers(np.broadcast_to(along, size), parameters["dtype"])]
        if name == "dot_general":
            return [self._dot(parameters, operands[0], operands[1], dtype)]
        if name in REDUCTIONS:
            return [self._reduced(name, parameters["axes"], operands[0], shape, dtype)]
        if name in ELEMENTWISE:
            fixed = tuple(sorted(parameters.items(), key=operator.itemgetter(0)))
            if name == "convert_element_type":
                if equation.invars[0].aval.dtype == parameters["new_dtype"]:
                    return [operands[0]]
                fixed = (("new_dtype", parameters["new_dtype"]), ("sharding", None), ("weak_type", False))
            return [self._each(equation.primitive, fixed, operands, shape, dtype)]
        if is_elementwise(equation):
            return self._unknown(equation, operands)
        raise NotScalar(f"holds `{name}`")

    def _unknown(self, equation, operands: list[np.ndarray]) -> list[np.ndarray]:
        """An elementwise operation that is not named here."""
        fixed, result = tuple(sorted(equation.params.items())), equation.outvars[0].aval
        return [self._each(equation.primitive, fixed, operands, result.shape, result.dtype)]

    def _each(self, primitive, parameters, operands, shape, dtype) -> np.ndarray:
        flat = [np.broadcast_to(x, shape).reshape(-1) for x in operands]
        return entries([self.operation(primitive, parameters, x, dtype) for x in zip(*flat, strict=True)], shape)

    def operation(self, primitive: Any, parameters: tuple, x: tuple["int | Number", ...], dtype) -> "int | Number":
        """The place of an operation, or the number or place that it comes to."""
        name = primitive.name
        known = [not isinstance(v, int) for v in x]
        if all(known):
            if name in _KNOWN:
                return dtype.type(_KNOWN[name](*x))
            if name == "convert_element_type":
                return dtype.type(x[0])
        if name == "select_n" and known[0]:
            return x[1 + int(x[0])]
        if name == "mul":
            for a, b in (x, x[::-1]):
                if not isinstance(a, int):
                    if a == 0:
                        return a
                    if a == 1:
                        return b
        if name in ("add", "add_any"):
            for a, b in (x, x[::-1]):
                if not isinstance(a, int) and a == 0:
                    return b
            primitive = jax.lax.add_p
        if name == "sub" and known[1] and x[1] == 0:
            return x[0]
        if name == "neg" and isinstance(x[0], int):
            step = self.made(x[0])
            if isinstance(step, Operation) and step.primitive.name == "neg":
                return step.operands[0]
        if name == "square" or (name == "integer_pow" and dict(parameters)["y"] == 2):
            primitive, parameters, x = jax.lax.mul_p, (), (x[0], x[0])
        if name in ("add", "add_any", "mul"):
            x = tuple(sorted(x, key=lambda v: (isinstance(v, int), v)))
        return self.step(Operation(primitive, parameters, x, dtype))

    def _dot(self, parameters, a, b, dtype) -> np.ndarray:
        A, B, shape = matrices(parameters, a, b)
        if A.shape[1] * B.size > _MOST:
            raise NotScalar(f"a product of more than {_MOST:,} operations")
        return self.product(A, B, shape, dtype)

    def product(self, A: np.ndarray, B: np.ndarray, shape: tuple[int, ...], dtype: Any) -> np.ndarray:
        """The products of the rows of `A` [batch, rows, k] with those of `B` [batch, columns, k], in a `shape`."""
        values = []
        for Ai, Bi in zip(A, B, strict=True):
            for row in Ai:
                for column in Bi:
                    pairs = zip(row, column, strict=True)
                    values.append(
                        self.folded(jax.lax.add_p, [self.one(jax.lax.mul_p, (), p, dtype) for p in pairs], dtype)
                    )
        return self.entries(values, shape)

    def _reduced(self, name, axes, a, shape, dtype) -> np.ndarray:
        rows = rows_over(a, axes)
        if not rows.shape[1]:
            raise NotScalar(f"`{name}` of nothing")
        return self.entries([self.folded(REDUCTIONS[name], row, dtype) for row in rows], shape)

    def folded(self, primitive: Any, values: Sequence[Any], dtype: Any) -> Any:
        """A primitive of the first two values, of what it gives and the third, and so on; the sum of none is zero."""
        total = values[0] if len(values) else self.numbers(0, dtype)[()]
        for value in values[1:]:
            total = self.one(primitive, (), (total, value), dtype)
        return total


class _Coordinate(Builder):
    """Takes vectors of the given length as vectors of one entry, where all that is done to them is elementwise."""

    def __init__(self, length: tuple[int, ...]):
        super().__init__()
        self._length, self.first_constant, self.constants = length, 0, []

    def thin(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        if shape not in ((), self._length):
            raise NotScalar(f"an array {shape} in a function of vectors {self._length}")
        return (1,) if shape else ()

    def numbers(self, value, dtype=None):
        value = np.asarray(value, dtype)
        if not self.thin(value.shape):
            return super().numbers(value)
        if (value == value[0]).all():
            return super().numbers(value[:1])
        self.constants.append(value)
        place = self.step(Input(self.first_constant + len(self.constants) - 1, 0, value.dtype))
        return entries([place], (1,))

    def _equation(self, equation, operands):
        name, shape = equation.primitive.name, self.thin(equation.outvars[0].aval.shape)
        if name == "broadcast_in_dim":
            return [np.broadcast_to(operands[0], shape)]
        if not (name in ELEMENTWISE | _AS_IT_IS or name in _INLINED or is_elementwise(equation)):
            raise NotScalar(f"holds `{name}`")
        return super()._equation(equation, operands)

    def _each(self, primitive, parameters, operands, shape, dtype):
        return super()._each(primitive, parameters, operands, self.thin(shape), dtype)


def _broadcast(parameters, x):
    shape, kept = parameters["shape"], parameters["broadcast_dimensions"]
    sizes = [1] * len(shape)
    for i, k in enumerate(kept):
        sizes[k] = x.shape[i]
    return [np.broadcast_to(x.reshape(sizes), shape)]


def _pad(parameters, x, value):
    widths = [(low, high) for low, high, _ in parameters["padding_config"]]
    if np.min(parameters["padding_config"], initial=0) < 0 or any(inner for *_, inner in parameters["padding_config"]):
        raise NotScalar("`pad` that cuts off or pads between entries")
    found = np.pad(x, widths)
    found[np.pad(np.zeros(x.shape, bool), widths, constant_values=True)] = value[()]
    return [found]


def _concatenated(parameters, *arrays):
    size = len(arrays) // parameters["count"]
    return [np.concatenate(arrays[k : k + size], axis=-1) for k in range(0, len(arrays), size)]


# What hands its argument on. A state's own small arrays are on one device, wherever the batch is.
_AS_IT_IS = frozenset(("copy", "materialise", "reshard", "stop_gradient"))

# What moves entries about and computes nothing.
MOVES: dict[str, Callable[..., list[np.ndarray]]] = {
    "broadcast_in_dim": _broadcast,
    "concatenate": lambda p, *arrays: [np.concatenate(arrays, axis=p["dimension"])],
    "concatenated": _concatenated,
    "expand_dims": lambda p, x: [np.expand_dims(x, p["dimensions"])],
    "pad": _pad,
    "reshape": lambda p, x: [x.reshape(p["new_sizes"])],
    "rev": lambda p, x: [np.flip(x, p["dimensions"])],
    "slice": lambda p, x: [x[tuple(map(slice, p["start_indices"], p["limit_indices"], p["strides"] or [1] * x.ndim))]],
    "split": lambda p, x: np.split(x, np.cumsum(p["sizes"])[:-1], axis=p["axis"]),
    "squeeze": lambda p, x: [x.squeeze(p["dimensions"])],
    "stack": lambda p, *arrays: [np.stack(arrays, axis=p["axis"])],
    "transpose": lambda p, x: [x.transpose(p["permutation"])],
    "unstack": lambda p, x: [row[k, ...] for row in [np.moveaxis(x, p["axis"], 0)] for k in range(len(row))],
}


def _only_needed(steps: list[Input | Operation], outputs: list[np.ndarray]) -> ScalarProgram:
    """Without the steps that no output needs."""
    needed = {x for output in outputs for x in output.reshape(-1) if isinstance(x, int)}
    for place in range(len(steps) - 1, -1, -1):
        step = steps[place]
        if place in needed and isinstance(step, Operation):
            needed.update(x for x in step.operands if isinstance(x, int))
    places = {old: new for new, old in enumerate(sorted(needed))}

    def moved(x):
        return places[x] if isinstance(x, int) else x

    kept = [
        step._replace(operands=tuple(moved(x) for x in step.operands)) if isinstance(step, Operation) else step
        for step in (steps[old] for old in sorted(needed))
    ]
    return ScalarProgram(kept, [entries([moved(x) for x in o.reshape(-1)], o.shape) for o in outputs])
