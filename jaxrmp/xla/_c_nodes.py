"""What a program in C is made of: sources that hold numbers, and nodes that compute them from others."""

from typing import Any, NamedTuple

import numpy as np

BITS, INDEX = 21, (1 << 21) - 1  # a place is a source's number and, in so many bits, an entry's
_SMALL = 500  # entries, of which Python finds the different ones sooner than NumPy


class Source(NamedTuple):
    """What holds numbers: an argument, an array in memory, or a single variable.

    `shared`, whether it is the same for all states; `kind`, "f" or "i"; `size` in entries; `of`, which argument, or -1;
    `single`, whether a variable; `table`, the numbers of a constant.
    """

    shared: bool
    kind: str
    size: int
    of: int = -1
    single: bool = False
    table: np.ndarray | None = None


class Node(NamedTuple):
    """What computes a source `out`: `op` and its `settings`, of `places`, over a `shape`.

    `op` is the name of a primitive, elementwise over `shape` or "single", or "dot", "reduce" or "copy";
    "while", and "carried", what else it gives.
    """

    out: int
    op: str
    settings: Any
    places: tuple[np.ndarray, ...]
    shape: tuple[int, ...]


def sources_of(places: np.ndarray) -> set[int]:
    """The sources of an operand's entries."""
    held = places[places >= 0] >> BITS
    return set((held if held.size < _SMALL else np.unique(held)).tolist())


def used_by(node: Node) -> set[int]:
    """The sources that a node needs."""
    return set().union(*map(sources_of, node.places)) if node.places else set()


def is_loop(node: Node) -> bool:
    """Whether a node is elementwise, over more than one entry."""
    return bool(node.shape) and is_elementwise(node.op)


def is_elementwise(op: str) -> bool:
    """Whether an operation is of single entries."""
    return op not in ("dot", "reduce", "copy", "while", "carried")
