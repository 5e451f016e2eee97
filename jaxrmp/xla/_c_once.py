"""Operations of which many entries are the same, which is seen by their operands."""

from collections.abc import Sequence

import numpy as np


def repeated(spread: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray] | None:
    """Where in operands what is at least half repetition comes first, and for each entry which of those it is."""
    size = spread[0].size
    code = np.zeros(size, dtype=np.int64)
    for places in spread:
        distinct, where = np.unique(places.reshape(-1), return_inverse=True)
        if 2 * len(distinct) > size:
            return None
        distinct, code = np.unique(code * len(distinct) + where.reshape(-1), return_inverse=True)
        if 2 * len(distinct) > size:
            return None
    first = np.full(len(distinct), size)
    np.minimum.at(first, code, np.arange(size))
    order = np.argsort(first)
    return first[order], np.argsort(order)[code]


def constant(places: np.ndarray) -> bool:
    """Whether an operand's entries are all the same one."""
    return bool((places == places.flat[0]).all())
