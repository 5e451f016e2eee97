"""One compiled program for any number of samples."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def by_parts(program: Callable[[jax.Array], Any], x: np.ndarray, size: int) -> Any:
    """`program`, of samples [size, ...], applied to `x` [T, ...] part by part, in double precision.

    **Returns** what it does, a pytree of arrays with a leading axis of samples, of all T: [T, ...].
    """
    x = np.asarray(x, float)
    whole = np.concatenate([x, np.repeat(x[-1:], -len(x) % size, axis=0)])
    with jax.enable_x64(True):
        found = [program(jnp.asarray(whole[k : k + size])) for k in range(0, len(whole), size)]
        return jax.tree.map(lambda *parts: np.concatenate(parts)[: len(x)], *found)
