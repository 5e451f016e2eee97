"""The switch: with the machinery, or the mathematics as written."""

import functools
import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, TypeVar

import jax

from .._errors import UnknownNameError

T = TypeVar("T")

_given = os.environ.get("JAXRMP_XLA", "on")
UnknownNameError.check("value of the environment variable JAXRMP_XLA", _given, ("on", "off"))
# JAX keeps what it traces and compiles apart by the value of such a context.
_on: Any = jax.make_user_context(_given == "on")


def machinery(on: bool) -> AbstractContextManager[None]:
    """Within this context, in this thread, policies are traced with the machinery of `jaxrmp.xla` or without.

    Off, what is traced and compiled is the mathematics as written: `jax.vmap` of it in a batch, and `compiled`
    compiles as `jax.jit` does. Results are the same to rounding. A function made by `jax.jit` is traced anew where the
    switch stands otherwise, and keeps both programs; one that `compiled` returned stays as it is.

    Outside, the environment variable `JAXRMP_XLA` says it: `on`, as without it, or `off`, when jaxrmp is imported.

    >>> import jax.numpy as jnp
    >>> from jaxrmp.leaves import Damping
    >>> with machinery(False):
    ...     str(jax.make_jaxpr(Damping(2.0, 1.0).evaluate)(jnp.ones(2), jnp.ones(2))).count("one_loop")
    0
    """
    return _on(bool(on))


def as_here(function: Callable[..., T]) -> Callable[..., T]:
    """`function`, to be called in another thread, where the switch and JAX's precision are to be what they are here.

    >>> from concurrent.futures import ThreadPoolExecutor
    >>> with machinery(False), ThreadPoolExecutor(1) as beside:
    ...     beside.submit(is_on).result(), beside.submit(as_here(is_on)).result()
    (True, False)
    """
    on, double = is_on(), jax.config.read("jax_enable_x64")

    @functools.wraps(function)
    def called(*arguments, **options):
        with machinery(on), jax.enable_x64(double):
            return function(*arguments, **options)

    return called


_alone: Any = jax.make_user_context(False)


def one_kernel() -> AbstractContextManager[None]:
    """Within this context, what is traced becomes one kernel of XLA's: nothing in it is called in C."""
    return _alone(True)


def may_call_c() -> bool:
    """Whether what is traced here may be called in C."""
    return is_on() and not _alone.value


def is_on() -> bool:
    """Whether the machinery is on."""
    return _on.value
