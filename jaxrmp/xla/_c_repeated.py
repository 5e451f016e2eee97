"""Statements that a C program repeats at other places in memory, as functions of those places."""

import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

_WHERE = re.compile(
    r"\b(?P<memory>[wm])\[(?P<offset>\d+)(?: \+ (?=[^\]]))?(?P<end>\])?|\b(?P<table>t\d+)\b|\b(?P<value>s\d+)\b"
)
_OWN = re.compile(r"\b[RN] (s\d+) =")
_MOST = 12  # arguments
_LEAST = 80  # characters that are worth a function


class _Shape(NamedTuple):
    """Statements as a `text` of the places and values they are about, and what these are."""

    text: str
    places: tuple[str, ...]
    kinds: tuple[str, ...]


def without_repetition(
    blocks: Sequence[Sequence[str]], kinds: dict[str, str], called: str = "f"
) -> tuple[list[str], list[str]]:
    """Definitions of functions, and the statements of all `blocks`, those that come again as calls.

    **Arguments**: `blocks`, lines each, whose arrays in memory do not overlap unless they begin together; `kinds`, the
    C type of each table and value by its name; `called`, how the functions' names begin.
    """
    shapes = [_shape("\n".join(lines), kinds) for lines in blocks]
    count = Counter(shape[:1] + shape[2:] for shape in shapes if shape)
    names: dict[tuple, str] = {}
    defined, body = [], []
    for lines, shape in zip(blocks, shapes, strict=True):
        key = shape and shape[:1] + shape[2:]
        if shape is None or key is None or count[key] < 2:
            body += lines
            continue
        if key not in names:
            names[key] = f"{called}{len(names)}"
            parameters = ", ".join(f"{kind}p{k}" for k, kind in enumerate(shape.kinds))
            defined += [f"static void {names[key]}({parameters}) {{", *shape.text.split("\n"), "}"]
        body.append(f"{names[key]}({', '.join(shape.places)});")
    return defined, body


def _shape(text: str, kinds: dict[str, str]) -> _Shape | None:
    """None for what is no function: too short, of too many places, of the arguments, or what others need its values."""
    own = {name: f"v{k}" for k, name in enumerate(dict.fromkeys(_OWN.findall(text)))}
    if len(text) < _LEAST or "in->" in text or (own and not text.startswith(("for", "INDEPENDENT", "{"))):
        return None
    places: dict[str, int] = {}
    types = []

    def place(actual: str, kind: str) -> str:
        if actual not in places:
            places[actual] = len(places)
            types.append(kind)
        return f"p{places[actual]}"

    def named(match: re.Match) -> str:
        if name := match["value"]:
            return own.get(name) or place(name, f"{kinds[name]} ")
        if name := match["table"]:
            return place(name, f"const {kinds[name]} *")
        memory, offset = match["memory"], match["offset"]
        found = place(f"{memory} + {offset}", "R *restrict " if memory == "w" else "N *restrict ")
        return f"{found}[0]" if match["end"] else f"{found}["

    text = _WHERE.sub(named, text)
    return _Shape(text, tuple(places), tuple(types)) if len(places) <= _MOST else None
