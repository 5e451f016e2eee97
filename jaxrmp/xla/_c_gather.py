"""Entries taken out of an array by known indices."""

from typing import Any

import numpy as np

from ._not_scalar import NotScalar


def gathered(parameters: dict[str, Any], operand: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """What JAX's `gather` takes out of `operand`, by indices that are known. **Raises** `NotScalar` beyond its ends."""
    numbers, sizes = parameters["dimension_numbers"], parameters["slice_sizes"]
    if numbers.operand_batching_dims:
        raise NotScalar("holds `gather` in batches")
    places = starts.reshape(-1, starts.shape[-1])
    found = []
    for start in places:
        window = [slice(None)] * operand.ndim
        for axis, at in zip(numbers.start_index_map, start, strict=True):
            if not 0 <= at <= operand.shape[axis] - sizes[axis]:
                raise NotScalar("holds `gather` beyond its array")
            window[axis] = slice(int(at), int(at) + sizes[axis])
        for axis, size in enumerate(sizes):
            if axis not in numbers.start_index_map:
                window[axis] = slice(0, size)
        found.append(operand[tuple(window)].squeeze(axis=numbers.collapsed_slice_dims))
    stacked = np.stack(found).reshape(*starts.shape[:-1], *found[0].shape)
    first, ndim = starts.ndim - 1, stacked.ndim
    order, own = [], iter(range(first, ndim))
    batch = iter(range(first))
    for k in range(ndim):
        order.append(next(own) if k in numbers.offset_dims else next(batch))
    return stacked.transpose(order)
