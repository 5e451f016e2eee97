"""A `while` of a stated count at most, in C: its condition and its body as a function of their own, and a `for`."""

import math
from typing import Any

import jax
import numpy as np
from jax.extend.core import jaxpr_as_fun

from .._errors import ConfigurationError
from ._c_fields import HIT, Field, struct
from ._c_nodes import Node
from ._c_types import kind_of
from ._not_scalar import NotScalar


def looped(program: Any, parameters: dict[str, Any], operands: list[np.ndarray]) -> list[np.ndarray]:
    """What a while with these `parameters` of its primitive gives, as arrays of places like its `operands`.

    **Raises** `NotScalar` if the program states no count.
    """
    if program.most is None:
        raise NotScalar("holds `while` without a stated count of steps")
    condition, body = parameters["cond_jaxpr"], parameters["body_jaxpr"]
    ends = parameters["cond_nconsts"], parameters["cond_nconsts"] + parameters["body_nconsts"]

    def step(*values):
        carried = values[ends[1] :]
        again = jaxpr_as_fun(condition)(*values[: ends[0]], *carried)
        return [*again, *jaxpr_as_fun(body)(*values[ends[0] : ends[1]], *carried)]

    avals = [*condition.in_avals[: ends[0]], *body.in_avals]
    closed = jax.make_jaxpr(step)(*(jax.ShapeDtypeStruct(a.shape, a.dtype) for a in avals))
    inputs = [Field(f"a{k}", a.shape, a.dtype) for k, a in enumerate(avals)]
    results = inputs[ends[1] :]
    outputs = [Field("again", (), np.dtype(bool)), *results]
    settings = {"closed": closed, "inputs": inputs, "outputs": outputs, "results": results}
    places = tuple(program._in_memory(p) if p.size else p for p in operands)
    found: dict[str, np.ndarray] = {}
    size = {kind: sum(f.size for f in results if kind_of(f.dtype) == kind) for kind in "fi"}
    out = program.source(program.is_shared(*places), "f", max(size["f"], 1))
    program.nodes.append(Node(out, "while", settings, places, (max(size["f"], 1),)))
    found["f"] = program.whole(out, (max(size["f"], 1),))
    found["i"] = found["f"][:0]
    if size["i"]:
        whole = program.source(program.is_shared(*places), "i", size["i"])
        program.nodes.append(Node(whole, "carried", {"of": out, "results": results}, (found["f"],), (size["i"],)))
        found["i"] = program.whole(whole, (size["i"],))
    start = {"f": 0, "i": 0}
    given: list[np.ndarray] = []
    for field in results:
        kind = kind_of(field.dtype)
        entries = found[kind]
        given.append(entries[start[kind] : start[kind] + field.size].reshape(field.shape))
        start[kind] += field.size
    return given


def require_count(most: int | None) -> None:
    """**Raises** `ConfigurationError` unless `most`, steps of a `while`, is None or a whole number from 1 on."""
    if most is not None and (isinstance(most, bool) or not isinstance(most, int) or not 1 <= most < 2**31 - 1):
        raise ConfigurationError(f"max_iterations is {most!r}, expected a whole number of steps from 1 on, or None.")


def declared(name: str) -> list[str]:
    """The arguments and results of a loop's own function, as variables."""
    return [f"{name}_in in_{name};", f"{name}_out out_{name};"]


def structs(name: str, node: Node) -> list[str]:
    """The types of these."""
    return [struct(f"{name}_in", node.settings["inputs"]), struct(f"{name}_out", [*node.settings["outputs"], HIT])]


def statements(name: str, node: Node, most: int, writer: Any) -> list[str]:
    """The statements of a "while" node: at most so many times its function `name`, which says whether
    once `again`."""
    settings = node.settings
    lines = ["{"]
    for field, places in zip(settings["inputs"], node.places, strict=True):
        if field.size:
            read = writer.reader(places, [field.size], False)(["e"])
            truth = " != 0" if field.dtype.kind == "b" else ""
            lines.append(_each(field, f"in_{name}.{field.name}{{0}} = {read}{truth};"))
    lines.append(f"for (int32_t n = 0; n <= {most}; n++) {{")
    lines += [f"{name}(&in_{name}, &out_{name});", f"out->{HIT.name} += out_{name}.{HIT.name};"]
    lines.append(f"if (!out_{name}.again) break;")
    lines.append(f"if (n == {most}) {{ out->{HIT.name}++; break; }}")
    lines += [_each(f, f"in_{name}.{f.name}{{0}} = out_{name}.{f.name}{{0}};") for f in settings["results"] if f.size]
    return [*lines, "}", *results_of(name, node, "f", writer), "}"]


def results_of(name: str, node: Node, kind: str, writer: Any) -> list[str]:
    """Statements that take a loop's results of a `kind` out of its variables."""
    lines, start = [], 0
    for field in node.settings["results"]:
        if kind_of(field.dtype) == kind and field.size:
            value = f"in_{name}.{field.name}{'[e]' if field.shape else ''}"
            value = f"-({value} != 0)" if field.dtype.kind == "b" else value
            into = writer.at(node.out, f"({start} + e)")
            lines.append(f"for (int e = 0; e < {field.size}; e++) {into} = {value};")
            start += field.size
    return lines


def _each(field: Field, text: str) -> str:
    """A statement for each entry of a field."""
    place = "[e]" if field.shape else ""
    return f"for (int e = 0; e < {math.prod(field.shape)}; e++) {{ {text.format(place)} }}"
