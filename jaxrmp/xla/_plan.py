"""How a function of small arrays is mapped over a batch: taken apart into scalars or as it stands, and why."""

import functools
import logging
import math
from typing import Any, NamedTuple

from jax.extend.core import ClosedJaxpr

from ._not_scalar import NotScalar
from ._scalar_program import ScalarProgram, coordinate_program, scalar_program

logger = logging.getLogger("jaxrmp.xla")
FEWEST = 64  # states from which on a loop is worth it


class Plan(NamedTuple):
    """`program`, the function's scalar program, or None where it is mapped as it stands, for a `reason`.

    `along`, if not zero, is the number of coordinates that the program, for one of them, is mapped over, too.
    """

    program: ScalarProgram | None
    reason: str = ""
    along: int = 0


def planned(jaxpr: ClosedJaxpr, batch: tuple[Any, ...]) -> Plan:
    """The plan for a function that is mapped over axes of the sizes `batch`, on a CPU."""
    if not batch:
        return Plan(None, "a single state")
    if not all(isinstance(n, int) for n in batch):
        return Plan(None, f"a batch of unknown size {batch}")
    if math.prod(batch) < FEWEST:
        return Plan(None, f"a batch of {math.prod(batch)} < {FEWEST} states")
    return _taken_apart(jaxpr)


@functools.lru_cache(maxsize=256)
def _taken_apart(jaxpr: ClosedJaxpr) -> Plan:
    try:  # first, since it is the smaller program, which compiles in a tenth of the time
        program, along = coordinate_program(jaxpr)
        return Plan(program, along=along)
    except NotScalar:
        pass
    try:
        return Plan(scalar_program(jaxpr))
    except NotScalar as error:
        logger.info("a function of %s is no loop: %s", [str(a) for a in jaxpr.in_avals], error)
        return Plan(None, str(error))
