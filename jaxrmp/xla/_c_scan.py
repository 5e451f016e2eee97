"""A `scan` of few steps, one after the other: the layers of a network."""

from typing import Any

import numpy as np

from ._not_scalar import NotScalar
from ._scalar_program import Builder

_MOST = 64  # steps


def scanned(builder: Builder, parameters: dict[str, Any], operands: list[np.ndarray]) -> list[np.ndarray]:
    """What a scan with these `parameters` of its primitive gives, as arrays of places like its `operands`."""
    steps, closed = parameters["length"], parameters["jaxpr"]
    if steps > _MOST:
        raise NotScalar(f"holds `scan` of {steps:,} steps")
    fixed, carried = _ends(parameters)
    carry, rows = operands[fixed:carried], []
    for k in reversed(range(steps)) if parameters["reverse"] else range(steps):
        arguments = [*operands[:fixed], *carry, *(x[k] for x in operands[carried:])]
        found = builder.run(closed.jaxpr, [builder.numbers(c) for c in closed.consts], arguments)
        carry = found[: len(carry)]
        rows.append(found[len(carry) :])
    rows = rows[::-1] if parameters["reverse"] else rows
    return [*carry, *map(np.stack, zip(*rows, strict=True))]


def _ends(parameters: dict[str, Any]) -> tuple[int, int]:
    """Where among the operands what stays the same ends, and what is carried."""
    if "ft_in" in parameters:  # of newer versions of JAX, such as 0.12
        fixed, carried, _ = (len(list(part)) for part in parameters["ft_in"].unpack())
    else:
        fixed, carried = parameters["num_consts"], parameters["num_carry"]
    return fixed, fixed + carried
