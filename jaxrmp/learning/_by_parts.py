"""One compiled program, in double precision, for any number of samples."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..xla import in_blocks


def by_parts(program: Callable[[jax.Array], Any], x: np.ndarray, size: int) -> Any:
    """As `in_blocks`, in double precision."""
    with jax.enable_x64(True):
        return in_blocks(lambda block: program(jnp.asarray(block)), np.asarray(x, float), size)
