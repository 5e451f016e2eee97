"""Programs that run once or twice, compiled in a fifth of the time."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar, cast

import jax

WITHOUT_OPTIMISING = {"xla_backend_optimization_level": 0}
WITHOUT_EMITTERS = {"xla_cpu_use_fusion_emitters": False}

Function = TypeVar("Function", bound=Callable[..., Any])


def quickly(function: Function) -> Function:
    """`function`, compiled as by `jax.jit`, but without what XLA does for programs that run long.

    For what would be compiled for longer than it runs. Results are the same to rounding. It cannot be part of another
    compiled function.

    **Arguments**: `function`, of pytrees of arrays. **Returns** a function that gives the same.

    >>> import jax.numpy as jnp
    >>> float(quickly(lambda x: x @ x)(jnp.ones(3)))
    3.0
    """

    @functools.cache  # once it is called: only then is XLA asked what it knows
    def program():
        return jax.jit(function, compiler_options=known_options(**WITHOUT_OPTIMISING, **WITHOUT_EMITTERS))

    @functools.wraps(function)
    def called(*arguments):
        return program()(*arguments)

    return cast(Function, called)


def known_options(**options: Any) -> dict[str, Any]:
    """Those of `options` of XLA's compiler that the jaxlib here knows: none but on a CPU, for which all are meant."""
    return {} if jax.default_backend() != "cpu" else {name: v for name, v in options.items() if _known(name, v)}


@functools.cache
def _known(name: str, value: Any) -> bool:
    try:
        jax.jit(lambda x: x, compiler_options={name: value}).lower(0).compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True
