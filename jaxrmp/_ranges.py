"""What numbers must be, checked where they are numbers and not placeholders of a transformation."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jax.core import Tracer

from ._errors import ConfigurationError

_RANGES = {
    "finite": (np.isfinite, "a finite number"),
    "positive": (lambda value: value > 0, "a positive number"),
    "non_negative": (lambda value: value >= 0, "a number that is not negative"),
    "below_one": (lambda value: value < 1, "a number below one"),
}


def require(
    owner: object,
    *,
    finite: Sequence[str] = (),
    positive: Sequence[str] = (),
    non_negative: Sequence[str] = (),
    below_one: Sequence[str] = (),
) -> None:
    """**Raises** `ConfigurationError` that names the first field of `owner` outside its range, NaN included."""
    given = {"finite": finite, "positive": positive, "non_negative": non_negative, "below_one": below_one}
    for kind, names in given.items():
        for name in names:
            require_number(type(owner).__name__, name, getattr(owner, name), kind)


def require_number(owner: str, name: str, value: Any, kind: str) -> None:
    """**Raises** `ConfigurationError` if `value`, the `name` of `owner`, has an entry outside a range; None passes."""
    if value is None or isinstance(value, Tracer):
        return
    holds, wording = _RANGES[kind]
    numbers = np.asarray(value, float)
    bad = ~holds(numbers)
    if bad.any():
        at = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ConfigurationError(f"{name}{list(at) if at else ''} of {owner} is {numbers[at]}, expected {wording}.")
