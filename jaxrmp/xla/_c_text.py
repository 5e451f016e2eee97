"""The text of a C program: the order of its nodes, which loops are one, where arrays are kept, how all is written."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ._c_loops import affine, blocks, heads, merged, row_major, strides_of
from ._c_nodes import BITS, INDEX, Node, sources_of, used_by
from ._c_order import grouped, laid_out

_SIGNS = {
    **dict.fromkeys(("add", "add_any"), "+"),
    **{"sub": "-", "mul": "*", "div": "/", "and": "&", "or": "|", "xor": "^"},
}
_COMPARISONS = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
_FOLDS = {"reduce_sum": "{0} + {1}", "reduce_and": "{0} & {1}", "reduce_or": "{0} | {1}"}
_ROWS, _PRODUCTS, _SUMS = 4, 8, 4  # rows and entries of a product computed at once; partial sums of a reduction
_TABLE_LINE = 24


def written(program: Any, dtypes: Sequence[Any], results: Sequence[tuple[np.ndarray, Any]], real: Any) -> str:
    """The C file of a program.

    **Arguments**: `program`, with its sources and nodes; `dtypes` of the arguments, and `results`, places and dtype of
    each; `real`, the type of its numbers.
    """
    return Writer(program, np.dtype(real)).file(dtypes, results)


class Writer:
    def __init__(self, program: Any, real: np.dtype):
        self.program, self.real = program, real
        self.sources, self.nodes = program.sources, program.nodes
        self.tables: dict[bytes, str] = {}
        self.table_lines: list[str] = []
        self.offsets: dict[int, int] = {}
        self.local: dict[int, str] = {}  # entries of a loop's own, by source

    def file(self, dtypes, results) -> str:
        shared = [n for n in self.nodes if self.sources[n.out].shared]
        mapped = [n for n in self.nodes if not self.sources[n.out].shared]
        kept = {s for places, _ in results for s in sources_of(places)}
        loads = self.loads(kept)
        shared_groups, groups = grouped(shared), grouped(mapped)
        shared_size = self.lay_out_shared(dtypes)
        offsets, size = laid_out(self.sources, [*loads, *groups], kept)
        self.offsets |= offsets
        once = [line for k in range(len(dtypes)) for line in self.shared_load(k, dtypes[k])]
        for group in shared_groups:
            once += self.code(group)
        body = [line for load in loads for line in self.load(load, dtypes)]
        for group in groups:
            body += self.code(group)
        body += [line for k, (places, dtype) in enumerate(results) for line in self.store(k, places, np.dtype(dtype))]
        width = self.real.itemsize
        lines = [
            f"#define REAL {'float' if width == 4 else 'double'}",
            f"#define WIDTH {width}",
            '#include "lanes.h"',
            "",
            *self.table_lines,
            "",
            "int program(const void **in, void **out, long first, long last) {",
            f"    size_t bytes = {size + 2} * sizeof(V) + {shared_size + 1} * sizeof(R);",
            "    char *memory = aligned_alloc(64, (bytes + 63) / 64 * 64);",
            "    if (!memory) return 1;",
            f"    V *w = (V *)memory; R *u = (R *)(w + {size + 1}); (void)w; (void)u; (void)in;",
            *(f"    {line}" for line in once),
            "    for (long begin = first; begin < last; begin += LANES) {",
            "        long count = last - begin < LANES ? last - begin : LANES;",
            *(f"        {line}" for line in body),
            "    }",
            "    free(memory);",
            "    return 0;",
            "}",
            "",
        ]
        return "\n".join(lines)

    # Memory

    def lay_out_shared(self, dtypes) -> int:
        size = 0
        for s, source in enumerate(self.sources):
            if source.shared and not source.single and source.table is None and not self.in_place(source, dtypes):
                self.offsets[s] = size
                size += source.size
        return size

    def in_place(self, source, dtypes) -> bool:
        """Whether an argument that all states share can be read where it is."""
        return source.of >= 0 and dtypes[source.of] == self.real

    # References

    def literal(self, value: Any) -> str:
        if value.dtype.kind == "b":
            return str(-int(value))
        if value.dtype.kind != "f":
            return f"({int(value)})"
        if np.isnan(value):
            return "((R)NAN)"
        if np.isinf(value):
            return "((R)INFINITY)" if value > 0 else "(-(R)INFINITY)"
        return f"({np.float32(value)!s}f)" if self.real.itemsize == 4 else f"({float(value)!s})"

    def entry(self, value: Any) -> str:
        """A number in a table, which has a type; what is of single precision as short as that, also among doubles."""
        if value.dtype.kind != "f" or not 0 <= abs(value) < 1e30 or np.float32(value) != value:
            return self.literal(value).removeprefix("(").removesuffix(")")
        text = str(np.float32(value))
        if text.endswith(".0"):
            return text if value == 0 and np.signbit(value) else text[:-2]
        text = text.replace("0.", ".", 1) if abs(value) < 1 else text
        return f"{text}{'f' if self.real.itemsize == 8 else ''}"

    def lanes(self, text: str, kind: str) -> str:
        return f"ALL({text})" if kind == "f" else f"ALL_N({text})"

    def at(self, source: int, index: str) -> str:
        """An entry of a source, as it is written."""
        found = self.sources[source]
        if source in self.local:
            return self.local[source]
        if found.single:
            return f"s{source}"
        if found.table is not None:
            return f"{self.table(found.table)}[{index}]"
        if source not in self.offsets:
            return f"((const R *)in[{found.of}])[{index}]"
        offset = self.offsets[source]
        place = index if not offset else f"{offset} + {index}" if index != "0" else str(offset)
        if found.shared:
            return f"u[{place}]" if found.kind == "f" else f"((N *)u)[{place}]"
        return f"w[{place}]" if found.kind == "f" else f"((VI *)w)[{place}]"

    def table(self, values: np.ndarray) -> str:
        flat = values.reshape(-1)
        key = flat.dtype.str.encode() + flat.tobytes()
        if key not in self.tables:
            name = self.tables[key] = f"t{len(self.tables)}"
            if flat.dtype == np.uint32:  # of entries
                kind, texts = "uint32_t", [str(x) for x in flat]
            else:
                kind = "R" if flat.dtype.kind == "f" else "N"
                texts = [self.entry(x) for x in flat]
            self.table_lines.append(f"static const {kind} {name}[{flat.size}] = {{")
            for k in range(0, len(texts), _TABLE_LINE):
                self.table_lines.append("    " + ", ".join(texts[k : k + _TABLE_LINE]) + ",")
            self.table_lines.append("};")
        return self.tables[key]

    def reader(self, places: np.ndarray, sizes: Sequence[int], lanes: bool) -> Callable[[Sequence[str]], str]:
        """How an operand with these places, of a loop over `sizes`, is written for given loop variables."""
        places = np.asarray(places).reshape(-1)
        first = int(places[0])
        if first < 0:
            value = self.program.known(first)
            text = self.literal(value)
            return lambda _: self.lanes(text, "f" if value.dtype.kind == "f" else "i") if lanes else text
        source = first >> BITS
        index = (places & INDEX).reshape(tuple(sizes))
        strides = strides_of(index)
        name = None if strides is not None else self.table(index.astype(np.uint32))
        found = self.sources[source]

        def read(variables):
            if name is None:
                where = affine(int(index.flat[0]), strides, variables)
            else:
                where = f"{name}[{affine(0, row_major(sizes), variables)}]"
            text = self.at(source, where)
            return self.lanes(text, found.kind) if lanes and found.shared else text

        return read

    # Code

    def loads(self, kept):
        """Arguments that each state has its own of, as nodes without operands."""
        used = kept.union(*map(used_by, self.nodes))
        return [
            [Node(s, "load", None, (), ())]
            for s, source in enumerate(self.sources)
            if source.of >= 0 and not source.shared and s in used
        ]

    def load(self, group, dtypes):
        s = group[0].out
        source = self.sources[s]
        dtype = dtypes[source.of]
        kind = c_type(dtype)
        value = f"a[e]{' != 0' if dtype.kind == 'b' else ''}"
        value = f"-({value})" if dtype.kind == "b" else value
        target = "((R *)w)" if source.kind == "f" else "((N *)w)"
        return [
            "for (int l = 0; l < LANES; l++) {",
            f"    const {kind} *a = (const {kind} *)in[{source.of}] + (begin + (l < count ? l : 0)) * {source.size};",
            f"    for (int e = 0; e < {source.size}; e++) {target}[({self.offsets[s]} + e) * LANES + l] = {value};",
            "}",
        ]

    def shared_load(self, k, dtype):
        for s, source in enumerate(self.sources):
            if source.of == k and s in self.offsets and source.shared:
                kind = c_type(dtype)
                value = (
                    f"-(((const {kind} *)in[{k}])[e] != 0)" if dtype.kind == "b" else f"((const {kind} *)in[{k}])[e]"
                )
                target = "u" if source.kind == "f" else "((N *)u)"
                return [f"for (int e = 0; e < {source.size}; e++) {target}[{self.offsets[s]} + e] = {value};"]
        return []

    def store(self, k: int, places: np.ndarray, dtype: np.dtype) -> list[str]:
        """Result `k` of these states, from the lanes."""
        flat = places.reshape(-1)
        kind, size = c_type(dtype), flat.size
        vector, single = ("V", "R") if dtype.kind == "f" else ("VI", "N")
        truth = " != 0" if dtype.kind == "b" else ""

        def one(read, index, entry):
            value = f"{vector} x = {read([index])};"
            return f"{value} for (int l = 0; l < count; l++) o[l * {size} + {entry}] = (({single} *)&x)[l]{truth};"

        if size > 4 and len(sources_of(flat)) == 1 and (flat >= 0).all():
            lines = [f"for (int e = 0; e < {size}; e++) {{ {one(self.reader(flat, [size], True), 'e', 'e')} }}"]
        else:
            lines = [f"{{ {one(self.reader(place, [], True), '0', e)} }}" for e, place in enumerate(flat)]
        return [f"{{ {kind} *o = ({kind} *)out[{k}] + begin * {size};", *lines, "}"]

    def code(self, group) -> list[str]:
        node = group[0]
        if node.op == "dot":
            return self.dot(node)
        if node.op == "reduce":
            return self.reduce(node)
        if node.op == "copy":
            return self.copy(node)
        if not node.shape:
            out = self.sources[node.out]
            operands = [self.reader(p, [], not out.shared)([]) for p in node.places]
            return [f"{self.type(out)} s{node.out} = {self.operation(node, operands)};"]
        return self.loop(group)

    def type(self, source) -> str:
        return {(True, "f"): "R", (True, "i"): "N", (False, "f"): "V", (False, "i"): "VI"}[source.shared, source.kind]

    def loop(self, group) -> list[str]:
        own = {n.out for n in group}
        shape = group[0].shape
        reads = [p for n in group for p in n.places if not (sources_of(p) & own)]
        sizes = merged(shape, [p & INDEX for p in reads if p.flat[0] >= 0 and strides_of(p & INDEX) is not None])
        variables = [f"i{k}" for k in range(len(sizes))]
        flat = affine(0, row_major(sizes), variables)
        lines, inside = heads(variables, sizes), []
        for node in group:
            out = self.sources[node.out]
            operands = [self.reader(p, sizes, not out.shared)(variables) for p in node.places]
            inside.append(f"{self.type(out)} s{node.out} = {self.operation(node, operands)};")
            if node.out in self.offsets:
                inside.append(f"{self.at(node.out, flat)} = s{node.out};")
            self.local[node.out] = f"s{node.out}"
        for s in own:
            del self.local[s]
        pad = "    " * len(lines)
        return [*lines, *(pad + line for line in inside), "}" * len(lines)]

    def copy(self, node) -> list[str]:
        flat, out = node.places[0].reshape(-1), self.sources[node.out]
        lines, start = [], 0
        keys = [(-1, int(p)) if p < 0 else (int(p) >> BITS, 0) for p in flat]
        while start < len(flat):
            end = start
            while end < len(flat) and keys[end] == keys[start]:
                end += 1
            read = self.reader(flat[start:end], [end - start], not out.shared)
            if end - start == 1:
                lines.append(f"{self.at(node.out, str(start))} = {read(['0'])};")
            else:
                into = self.at(node.out, affine(start, [1], ["e"]))
                lines.append(f"for (int e = 0; e < {end - start}; e++) {into} = {read(['e'])};")
            start = end
        return lines

    def reduce(self, node) -> list[str]:
        rows, length = node.shape
        out = self.sources[node.out]
        kind, lanes = self.type(out), not out.shared
        read = self.reader(node.places[0], node.shape, lanes)
        sums = min(_SUMS, length)
        whole = length - length % sums
        fold = self.fold(node, kind)
        lines = [f"for (int i = 0; i < {rows}; i++) {{"]
        lines += [f"    {kind} c{k} = {read(['i', str(k)])};" for k in range(sums)]
        lines.append(f"    for (int j = {sums}; j < {whole}; j += {sums}) {{")
        lines += [f"        c{k} = {fold.format(f'c{k}', read(['i', f'(j + {k})']))};" for k in range(sums)]
        lines.append("    }")
        lines += [f"    c0 = {fold.format('c0', read(['i', str(k)]))};" for k in range(whole, length)]
        lines += [f"    c0 = {fold.format('c0', f'c{k}')};" for k in range(1, sums)]
        return [*lines, f"    {self.at(node.out, 'i')} = c0;", "}"]

    def fold(self, node, kind: str) -> str:
        """How a reduction puts two of a `kind` together."""
        by = node.settings["by"]
        return _FOLDS.get(by) or f"{by.removeprefix('reduce_')}_{kind.lower()}({{0}}, {{1}})"

    def dot(self, node) -> list[str]:
        batch, rows, length, columns = node.shape
        out = self.sources[node.out]
        kind, lanes = self.type(out), not out.shared
        A, B = node.places
        a, b = self.reader(A, (batch, rows, length), lanes), self.reader(B, (batch, columns, length), lanes)
        lines = [f"for (int n = 0; n < {batch}; n++) {{"]
        for first, end, m in blocks(rows, _ROWS):
            lines.append(f"    for (int i = {first}; i < {end}; i += {m}) {{")
            for left, right, c in blocks(columns, _PRODUCTS // m):
                lines.append(f"        for (int j = {left}; j < {right}; j += {c}) {{")
                pairs = [(r, s) for r in range(m) for s in range(c)]
                zero = "{0}" if lanes else "0"
                lines.append("            " + " ".join(f"{kind} c{r}{s} = {zero};" for r, s in pairs))
                lines.append(f"            for (int k = 0; k < {length}; k++) {{")
                for s in range(c):
                    lines.append(f"                {kind} b{s} = {b(['n', f'(j + {s})', 'k'])};")
                for r in range(m):
                    lines.append(f"                {kind} a{r} = {a(['n', f'(i + {r})', 'k'])};")
                lines.append("                " + " ".join(f"c{r}{s} += a{r} * b{s};" for r, s in pairs))
                lines.append("            }")
                for r, s in pairs:
                    where = f"(n * {rows} + i + {r}) * {columns} + j + {s}"
                    if node.settings.get("batch") == "last":
                        where = f"((i + {r}) * {columns} + j + {s}) * {batch} + n"
                    lines.append(f"            {self.at(node.out, where)} = c{r}{s};")
                lines.append("        }")
            lines.append("    }")
        return [*lines, "}"]

    def operation(self, node, x: list[str]) -> str:
        out = self.sources[node.out]
        name, settings = node.op, node.settings
        suffix = self.type(out).lower()
        if name in _SIGNS:
            return f"{x[0]} {_SIGNS[name]} {x[1]}"
        if name in _COMPARISONS:
            return f"-({x[0]} {_COMPARISONS[name]} {x[1]})" if out.shared else f"{x[0]} {_COMPARISONS[name]} {x[1]}"
        if name == "neg":
            return f"-{x[0]}"
        if name == "not":
            return f"~{x[0]}"
        if name == "square":
            return f"{x[0]} * {x[0]}"
        if name == "select_n":
            return f"select_{suffix}({x[0]}, {x[2]}, {x[1]})"
        if name == "clamp":
            return f"min_{suffix}(max_{suffix}({x[1]}, {x[0]}), {x[2]})"
        if name == "integer_pow":
            return _power(x[0], settings["y"])
        if name == "round":
            return f"round_{'away' if int(settings['rounding_method']) == 0 else 'even'}_{suffix}({x[0]})"
        if name == "convert_element_type":
            return self.conversion(x[0], settings["old"], settings["new"], out.shared)
        if name == "is_finite":
            suffix = {"n": "r", "vi": "v"}[suffix]
        return f"{name}_{suffix}({', '.join(x)})"

    def conversion(self, x: str, old: str, new: str, shared: bool) -> str:
        if new == "b":
            return f"-({x} != 0)" if shared else f"({x} != 0)"
        x = f"-{x}" if old == "b" else x
        if old == "f":
            return f"whole_{'r' if shared else 'v'}({x})"
        if shared:
            return f"({'R' if new == 'f' else 'N'})({x})"
        if new == "f":
            return f"__builtin_convertvector({x}, V)"
        return x


def _power(x: str, y: int) -> str:
    if y == 0:
        return f"({x} * 0 + 1)"
    text = " * ".join([f"({x})"] * abs(y)) if abs(y) <= 4 else None
    if text is None:
        half = _power(x, abs(y) // 2)
        text = f"({half}) * ({half})" + (f" * ({x})" if abs(y) % 2 else "")
    return f"1 / ({text})" if y < 0 else text


def c_type(dtype: Any) -> str:
    dtype = np.dtype(dtype)
    if dtype.kind == "f":
        return "float" if dtype.itemsize == 4 else "double"
    return "uint8_t" if dtype.kind == "b" else f"{'u' * (dtype.kind == 'u')}int{8 * dtype.itemsize}_t"
