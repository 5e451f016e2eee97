"""Operands of products and reductions, laid out in rows."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np


def matrices(
    parameters: dict[str, Any], a: np.ndarray, b: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
    """The operands of a `dot_general` as [batch, rows, k] and [batch, columns, k], and the shape of its result."""
    (over_a, over_b), (batch_a, batch_b) = parameters["dimension_numbers"]
    free_a = [i for i in range(a.ndim) if i not in (*over_a, *batch_a)]
    free_b = [i for i in range(b.ndim) if i not in (*over_b, *batch_b)]
    batch, k = [a.shape[i] for i in batch_a], math.prod(a.shape[i] for i in over_a)
    rows, columns = [a.shape[i] for i in free_a], [b.shape[i] for i in free_b]
    A = a.transpose([*batch_a, *free_a, *over_a]).reshape(math.prod(batch), math.prod(rows), k)
    B = b.transpose([*batch_b, *free_b, *over_b]).reshape(math.prod(batch), math.prod(columns), k)
    return A, B, (*batch, *rows, *columns)


def rows_over(a: np.ndarray, axes: Sequence[int]) -> np.ndarray:
    """What is reduced over some axes, a row for each entry that is left."""
    rest = [i for i in range(a.ndim) if i not in axes]
    sizes = [math.prod(a.shape[i] for i in along) for along in (rest, axes)]
    return a.transpose([*rest, *axes]).reshape(sizes)
