"""Arguments of compiled functions: whether they are what it was compiled for."""

from typing import Any

import numpy as np

from .._errors import ShapeError


def fitting(leaf: Any, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """An argument as an array that fits where `shape` and `dtype` are expected; **raises** `ShapeError` for others."""
    if type(leaf) is np.ndarray and leaf.dtype is dtype and leaf.shape == shape:
        return leaf
    leaf = np.asarray(leaf)
    if leaf.shape != shape or not np.can_cast(leaf.dtype, dtype, "same_kind"):
        raise ShapeError(
            f"an argument has shape {leaf.shape} and type {leaf.dtype}; this was compiled for {shape} and {dtype}."
        )
    return leaf
