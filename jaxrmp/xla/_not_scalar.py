"""Why a function is not taken apart."""

from typing import Any


class NotScalar(Exception):
    """A function that is not worth taking apart into scalars, or cannot be; the message says why, `within` of which
    equations, from inside out."""

    def __init__(self, reason: str):
        super().__init__(reason)
        self.within: list[Any] = []


class UnknownOperation(NotScalar):
    """An elementwise operation that has no form in C here: one of a newer JAX, or one that is rare."""

    def __init__(self, name: str):
        super().__init__(f"holds `{name}`")
        self.name = name
