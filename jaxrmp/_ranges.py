"""What numbers must be, said where a field is declared: `weight: Positive[jax.Array | float] = 1.0`.

Fields of a `pytree` and of `settings` are checked as a value is made, where they are numbers and not placeholders of a
transformation.
"""

import dataclasses
import inspect
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple, TypeVar, dataclass_transform

import numpy as np
from jax.core import Tracer

from ._errors import ConfigurationError

T = TypeVar("T")


class Range(NamedTuple):
    """Which numbers there may be: `holds`, elementwise, and its `wording` for who gave another."""

    holds: Callable[[np.ndarray], np.ndarray]
    wording: str


POSITIVE = Range(lambda value: value > 0, "a positive number")
Positive = Annotated[T, POSITIVE]
NonNegative = Annotated[T, Range(lambda value: value >= 0, "a number that is not negative")]
BelowOne = Annotated[T, Range(lambda value: value < 1, "a number below one")]
FINITE = Range(np.isfinite, "a finite number")
Finite = Annotated[T, FINITE]


def ranges_of(cls: type) -> list[tuple[str, Range]]:
    """Names and ranges of the fields that declare one, in order; a field may have several."""
    declared = [item for base in reversed(cls.__mro__) for item in inspect.get_annotations(base).items()]
    found = [(name, r) for name, hint in declared for r in getattr(hint, "__metadata__", ())]
    return [(name, r) for name, r in found if isinstance(r, Range)]


def with_ranges(cls: type[T], section: str | None = None) -> type[T]:
    """Let `cls` check its fields of a range before its own `__post_init__`, NaN included; None passes.

    Where it is a `section` of settings, numbers must be finite besides, and lists of them must hold one at least.
    """
    ranges = ranges_of(cls)
    own = getattr(cls, "__post_init__", None)

    def __post_init__(self):
        for name, allowed in ranges:
            value = getattr(self, name)
            if section is None:
                require_number(cls.__name__, name, value, allowed)
            elif not (np.size(value) and np.isfinite(value).all() and allowed.holds(np.asarray(value)).all()):
                raise ConfigurationError(f"{section}.{name} is {value!r}, expected {allowed.wording}.")
        if own is not None:
            own(self)

    if ranges:
        cls.__post_init__ = __post_init__  # type: ignore[attr-defined]
    return cls


@dataclass_transform(frozen_default=True)
def settings(section: str) -> Callable[[type[T]], type[T]]:
    """Make a class a frozen dataclass that checks the ranges of its fields; `section` is what a user calls it."""
    return lambda cls: dataclasses.dataclass(frozen=True)(with_ranges(cls, section))


def require_number(owner: str, name: str, value: Any, allowed: Range = POSITIVE) -> None:
    """**Raises** `ConfigurationError` if `value`, the `name` of `owner`, has an entry outside a range; None passes."""
    if value is None or isinstance(value, Tracer):
        return
    numbers = np.asarray(value, float)
    bad = ~allowed.holds(numbers)
    if bad.any():
        at = tuple(int(i) for i in np.argwhere(bad)[0])
        where = f"{name}{list(at) if at else ''} of {owner}"
        raise ConfigurationError(f"{where} is {numbers[at]}, expected {allowed.wording}.")
