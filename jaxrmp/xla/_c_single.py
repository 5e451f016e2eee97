"""A function of one state as C that stands alone: C99 and its mathematical functions, nothing kept between calls.

Of the same nodes as programs of several states, as numbers in place of vectors. Arguments and results are the fields of
two structs; working memory is the function's own, of a size that is known.
"""

import functools
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jax.extend.core import ClosedJaxpr

from ._c_dot import LANES, LEAST, added, product
from ._c_fields import HIT, Field
from ._c_loops import blocks
from ._c_nodes import BITS, Node, sources_of, used_by
from ._c_order import grouped, laid_out
from ._c_parts import taken_apart
from ._c_repeated import without_repetition
from ._c_text import Writer
from ._c_while import declared, results_of, statements, structs
from ._not_scalar import NotScalar

_MOST_STACK = 1 << 20  # bytes
_LONGEST = 200  # characters of an expression that becomes part of another
# What loops have in place of these: else, for its branches or errno, compilers make no vectors of them.
_IN_LOOPS = {"select_r(": "picked_r(", "max_r(": "larger_r(", "min_r(": "smaller_r("}
_ROOTS = {"sqrt": "sqrts_r", "rsqrt": "rsqrts_r"}  # in single precision
_INDEPENDENT = (
    "/* Before a loop none of whose steps reads what another writes. */",
    "#if defined(__GNUC__) && !defined(__clang__)",
    '#define INDEPENDENT _Pragma("GCC ivdep")',
    "#else",
    "#define INDEPENDENT",
    "#endif",
)
_CALLED = re.compile(r"\b(\w+_[rn])\(")


class Single(NamedTuple):
    """A C function: its `text`, with all that it needs but the structs, its working memory `stack`, in bytes, and how
    many scalar `operations` it takes."""

    text: str
    stack: int
    operations: int


def single_program(
    closed: ClosedJaxpr, name: str, inputs: Sequence[Field], outputs: Sequence[Field], most: int | None = None
) -> Single:
    """A function as C: `void NAME(const NAME_in *in, NAME_out *out)`.

    **Arguments**: `closed`, the function, and its `name`; `inputs` and `outputs`, a field for each of its
    arguments and results; `most`, steps of a `while`: if it is stated, the struct of results has `HIT`, too.
    **Raises** `NotScalar` for what it cannot say in C, as `taken_apart`, and what takes more than 1 MiB of memory.
    """
    parts = taken_apart(closed, [False] * len(inputs), most)
    return _Writer(parts.program, parts.real, inputs, outputs).function(name, parts.dtypes, parts.results)


class _Writer(Writer):
    """Writes all sources as numbers that are the same for all states, of which there is one."""

    def __init__(self, program: Any, real: np.dtype, inputs: Sequence[Field], outputs: Sequence[Field]):
        super().__init__(program, real)
        for s, source in enumerate(program.sources):  # constants are part of the text
            if source.of >= len(inputs):
                table = program.constants[source.of - len(inputs)]
                program.sources[s] = source._replace(of=-1, table=table.reshape(-1))
        self.inputs, self.outputs, self.name = inputs, outputs, ""
        self.loops: dict[int, str] = {}  # the functions of its loops, by source
        self.before: list[str] = []  # definitions of these
        self.stack = 0
        self.large: dict[bytes, str] = {}  # constants that products read, by their numbers

    def definition(
        self, name: str, dtypes: Sequence[np.dtype], results: Sequence[tuple[np.ndarray, np.dtype]], static: str = ""
    ) -> list[str]:
        """The function `name`, and before it those that it calls."""
        self.name = name
        kept = {s for places, _ in results for s in sources_of(places)}
        loads = [[Node(s, "load", None, (), ())] for s in sorted(kept.union(*map(used_by, self.nodes)))]
        loads = [load for load in loads if self.is_converted(self.sources[load[0].out])]
        groups = grouped(self.nodes)
        size = {}
        for kind in "fi":
            offsets, size[kind] = laid_out(self.sources, [*loads, *groups], kept, kind)
            self.offsets |= offsets
        blocks = [self.load(load, dtypes) for load in loads]
        inlined = self.used_at_once(groups) - kept
        for group in groups:
            lines = self.code(group)
            if group[0].out in inlined and len(lines[0]) < _LONGEST:
                self.local[group[0].out] = f"({lines[0].partition(' = ')[2].removesuffix(';')})"
            else:
                blocks.append(lines)
        kinds = {f"s{s}": "R" if source.kind == "f" else "N" for s, source in enumerate(self.sources)}
        kinds |= {line.split()[3].partition("[")[0]: line.split()[2] for line in self.table_lines if "static" in line}
        functions, body = without_repetition(blocks, kinds, f"{name}_f" if static else "f")
        for field, (places, _) in zip(self.outputs, results, strict=True):
            body += self.stored(field, places)
        width = self.real.itemsize
        self.stack += (size["f"] + size["i"]) * width
        memory = [f"{kind} {w}[{size[k]}];" for k, kind, w in (("f", "R", "w"), ("i", "N", "m")) if size[k]]
        memory += [line for loop in self.loops.values() for line in declared(loop)]
        if self.program.most is not None:
            memory.append(f"out->{HIT.name} = 0;")
        return [
            *self.before,
            *functions,
            "",
            f"{static}void {name}(const {name}_in *in, {name}_out *out) {{",
            *(f"    {line}" for line in memory),
            *([] if "in->" in "\n".join([*functions, *body]) else ["    (void)in;"]),
            *(f"    {line}" for line in body),
            "}",
            "",
        ]

    def function(self, name: str, dtypes: Sequence[np.dtype], results: Sequence[tuple[np.ndarray, np.dtype]]) -> Single:
        defined = self.definition(name, dtypes, results)
        text, width = "\n".join(defined), self.real.itemsize
        kind, whole = ("float", "int32_t") if width == 4 else ("double", "int64_t")
        lines = [
            "#include <math.h>",
            "#include <stdint.h>",
            "",
            f"typedef {kind} R;",
            f"typedef {whole} N;",
            f"#define F(name) name{'##f' if width == 4 else ''}",
            f"#define LAST INT{8 * width}_MAX",
            *(_INDEPENDENT if "INDEPENDENT" in text else ()),
            "",
            *_functions(text, width == 4),
            "",
            *self.table_lines,
            "",
            *defined,
        ]
        operations = sum(math.prod(n.shape) for n in self.nodes)
        if self.stack > _MOST_STACK:
            raise NotScalar(f"takes {self.stack:,} bytes of working memory, more than {_MOST_STACK:,}")
        return Single("\n".join(lines), self.stack, operations)

    def code(self, group):
        node = group[0]
        if node.op == "carried":
            return results_of(self.loops[node.settings["of"]], node, "i", self)
        if node.op != "while":
            return super().code(group)
        name = self.loops[node.out] = f"{self.name}_loop{len(self.loops)}"
        inputs, outputs = node.settings["inputs"], node.settings["outputs"]
        parts = taken_apart(node.settings["closed"], [False] * len(inputs), self.program.most)
        inner = _Writer(parts.program, self.real, inputs, outputs)
        inner.tables, inner.table_lines, inner.large = self.tables, self.table_lines, self.large
        self.before += [*structs(name, node), *inner.definition(name, parts.dtypes, parts.results, "static ")]
        self.stack += inner.stack
        return statements(name, node, self.program.most, self)

    def used_at_once(self, groups: Sequence[Sequence[Node]]) -> set[int]:
        """Single values that one other is made of, before anything else is written to memory, and nothing else."""
        used: dict[int, list[int]] = {}
        where, run = {}, 0
        for group in groups:
            node = group[0]
            run += bool(node.shape) or node.op == "copy"
            where[node.out] = run if not node.shape and node.op != "copy" else -1
            for each in group:
                for place in (int(p) >> BITS for places in each.places for p in np.atleast_1d(places).flat if p >= 0):
                    used.setdefault(place, []).append(each.out)
        return {
            s
            for s, users in used.items()
            if len(users) == 1 and where.get(s, -1) >= 0 and where.get(users[0], -2) == where[s]
        }

    def is_converted(self, source: Any) -> bool:
        """Whether an argument is of another type than what the program computes with."""
        kind = self.real if source.kind == "f" else self.program.whole_number
        return source.of >= 0 and self.inputs[source.of].dtype != kind

    def argument(self, source: Any, index: str) -> str:
        field = self.inputs[source.of]
        return f"in->{field.name}[{index}]" if field.shape else f"in->{field.name}"

    def at(self, source, index):
        found = self.sources[source]
        if source in self.local or found.single or found.table is not None:
            return super().at(source, index)
        if source not in self.offsets:
            return self.argument(found, index)
        offset = self.offsets[source]
        place = f"{offset} + {index}" if index != "0" else str(offset)
        return f"{'w' if found.kind == 'f' else 'm'}[{place}]"

    def dot(self, node):
        whole = self.sources[node.out].kind != "f"
        few = max(node.shape[1], node.shape[3]) < LEAST and node.shape[2] < LEAST * LANES and not node.settings
        if whole or few:
            return super().dot(node)
        return product(node, self, functools.partial(self.at, node.out))

    def loop(self, group):
        lines = super().loop(group)
        inner = max(k for k, line in enumerate(lines) if line.startswith("for "))
        return [*lines[:inner], f"INDEPENDENT {lines[inner]}", *lines[inner + 1 :]]

    def reduce(self, node):
        rows, length = node.shape
        kind = self.type(self.sources[node.out])
        read, fold = self.reader(node.places[0], node.shape, False), in_loops(self.fold(node, kind))
        lines = [f"for (int i = 0; i < {rows}; i++) {{"]
        if length < 2 * LANES or length < rows:  # along the rows
            lines.append(f"{kind} c = {read(['i', '0'])};")
            lines += [f"c = {fold.format('c', read(['i', str(k)]))};" for k in range(1, length)]
            return [*lines, f"{self.at(node.out, 'i')} = c;", "}"]
        lines.append(f"{kind} c[{LANES}];")
        lines.append(f"for (int l = 0; l < {LANES}; l++) {{ c[l] = {read(['i', 'l'])}; }}")
        for first, end, m in blocks(length - LANES, LANES):
            more = fold.format("c[l]", read(["i", f"(k + l + {LANES})"]))
            lines.append(f"for (int k = {first}; k < {end}; k += {m}) {{")
            lines.append(f"for (int l = 0; l < {m}; l++) {{ c[l] = {more}; }} }}")
        return [*lines, *added(["c"], fold), f"{self.at(node.out, 'i')} = c[0];", "}"]

    def operation(self, node, x):
        if node.shape and node.op in _ROOTS and self.real.itemsize == 4:
            return f"{_ROOTS[node.op]}({x[0]})"
        text = super().operation(node, x)
        return in_loops(text) if node.shape else text

    def load(self, group, dtypes):
        s = group[0].out
        source = self.sources[s]
        value = self.argument(source, "e")
        value = f"-({value} != 0)" if dtypes[source.of].kind == "b" else f"(N){value}"
        return [f"for (int e = 0; e < {source.size}; e++) {self.at(s, 'e')} = {value};"]

    def stored(self, field: Field, places: np.ndarray) -> list[str]:
        """A result, in its field."""
        flat = places.reshape(-1)
        truth = " != 0" if field.dtype.kind == "b" else ""
        if flat.size > 4 and len(sources_of(flat)) == 1 and (flat >= 0).all():
            value = self.reader(flat, [flat.size], False)(["e"])
            return [f"for (int e = 0; e < {flat.size}; e++) out->{field.name}[e] = {value}{truth};"]
        values = [self.reader(place, [], False)(["0"]) for place in flat]
        index = [f"[{e}]" if field.shape else "" for e in range(flat.size)]
        return [f"out->{field.name}{i} = {value}{truth};" for i, value in zip(index, values, strict=True)]


def in_loops(text: str) -> str:
    """A statement as a loop has it, so that compilers can make vectors of it."""
    for name, other in _IN_LOOPS.items():
        text = text.replace(name, other)
    return text


def _functions(text: str, single: bool) -> list[str]:
    """The definitions of the functions that a text calls, in `single` precision or double."""
    known = {name: each for name, each in _definitions().items() if single or "(float a)" not in each}
    called, new = set(), set(_CALLED.findall(text))
    while new:
        called |= new
        new = {name for each in new & known.keys() for name in _CALLED.findall(known[each])} - called
    own = [each.replace("float a", "R a") for name, each in known.items() if name in called]
    for name in sorted(called - known.keys()):
        two = name in ("atan2_r", "pow_r")
        arguments, values = ("R a, R b", "a, b") if two else ("R a", "a")
        own.append(f"static inline R {name}({arguments}) {{ return F({name[:-2]})({values}); }}")
    return own


@functools.cache
def _definitions() -> dict[str, str]:
    """The functions of `scalars.h`, by name."""
    text = Path(__file__).with_name("scalars.h").read_text()
    found = re.findall(r"^static inline .*?}$", text, re.DOTALL | re.MULTILINE)
    return {_CALLED.findall(each)[0]: each for each in found}
