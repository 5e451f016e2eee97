"""One compiled program for any number of samples."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np


def in_blocks(program: Callable[[np.ndarray], Any], x: np.ndarray, size: int = 256) -> Any:
    """`program`, of samples [`size`, ...], applied to `x` [T, ...] block by block, the last filled up with copies.

    **Returns** what it does, a pytree of NumPy arrays with a leading axis of samples, of all T: [T, ...].
    """
    whole = np.concatenate([x, np.repeat(x[-1:], -len(x) % size, axis=0)])
    found = [program(whole[k : k + size]) for k in range(0, len(whole), size)]
    return jax.tree.map(lambda *blocks: np.concatenate(blocks)[: len(x)], *found)
