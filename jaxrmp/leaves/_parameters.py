"""What a leaf's parameters must be, checked where they are numbers and not placeholders of a transformation."""

from collections.abc import Sequence

import numpy as np
from jax.core import Tracer

from .._errors import ConfigurationError


def require(
    leaf: object,
    *,
    positive: Sequence[str] = (),
    non_negative: Sequence[str] = (),
    below_one: Sequence[str] = (),
) -> None:
    """**Raises** `ConfigurationError` that names the first field of `leaf` outside its range, NaN included."""
    for names, holds, wording in (
        (positive, lambda value: value > 0, "a positive number"),
        (non_negative, lambda value: value >= 0, "a number that is not negative"),
        (below_one, lambda value: value < 1, "a number below one"),
    ):
        for name in names:
            value = getattr(leaf, name)
            if value is not None and not isinstance(value, Tracer) and not np.all(holds(np.asarray(value, float))):
                raise ConfigurationError(f"{name} of {type(leaf).__name__} is {value}, expected {wording}.")
