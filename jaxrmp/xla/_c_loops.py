"""Loops over the entries of arrays: how few are enough, and where in memory an entry is."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np


def strides_of(index: np.ndarray) -> list[int] | None:
    """How far entries are apart along each axis, if that is the same everywhere."""
    corner = (0,) * index.ndim
    base = int(index[corner])
    found = []
    for axis, size in enumerate(index.shape):
        at = tuple(1 if k == axis else 0 for k in range(index.ndim))
        found.append(int(index[at]) - base if size > 1 else 0)
    expected = base
    for axis, (size, stride) in enumerate(zip(index.shape, found, strict=True)):
        along = np.arange(size) * stride
        expected = expected + along.reshape([-1 if k == axis else 1 for k in range(index.ndim)])
    return found if np.array_equal(np.broadcast_to(expected, index.shape), index) else None


def row_major(sizes: Sequence[int]) -> list[int]:
    """Strides of an array of these sizes."""
    return [math.prod(sizes[k + 1 :]) for k in range(len(sizes))]


def merged(shape: Sequence[int], indices: Sequence[np.ndarray]) -> list[int]:
    """The sizes of as few loops as run over all of the operands."""
    strides: list[Any] = [strides_of(index.reshape(tuple(shape))) for index in indices]
    sizes, steps = [shape[0]], [[s[0]] for s in strides]
    for axis in range(1, len(shape)):
        size = shape[axis]
        together = all(
            sizes[-1] == 1 or size == 1 or own[-1] == s[axis] * size for own, s in zip(steps, strides, strict=True)
        )
        if together:
            for own, s in zip(steps, strides, strict=True):
                own[-1] = s[axis] if size > 1 else own[-1]
            sizes[-1] *= size
        else:
            sizes.append(size)
            for own, s in zip(steps, strides, strict=True):
                own.append(s[axis])
    return sizes


def affine(base: int, strides: Sequence[int] | None, variables: Sequence[str]) -> str:
    """An index, `base` and the loop variables times their strides, in C."""
    terms = [v if s == 1 else f"{v} * {s}" for v, s in zip(variables, strides or (), strict=False) if s and v != "0"]
    return " + ".join([*terms, str(base)] if base or not terms else terms)


def heads(variables, sizes) -> list[str]:
    """The first lines of nested loops, in C."""
    return [f"for (int {v} = 0; {v} < {n}; {v}++) {{" for v, n in zip(variables, sizes, strict=True)]


def blocks(size: int, most: int) -> list[tuple[int, int, int]]:
    """A range as blocks of `most` and what is left over: from, to, and at once."""
    whole = size - size % most
    found = [(0, whole, most)] if whole else []
    return [*found, (whole, size, size - whole)] if size > whole else found
