"""Batches of a function by a C program, where a C compiler is at hand: states in the lanes of the processor's vectors.

XLA:CPU runs a whole policy as some two hundred kernels that write all they compute to memory. C that is written from
the same operations keeps it in the processor's caches, and is compiled in less time. Derivatives, single states, other
platforms and machines without a compiler get what JAX makes of the function.
"""

import ctypes
import functools
import platform
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.extend.core import ClosedJaxpr, Primitive
from jax.interpreters import mlir

from ._c_compiler import library_of
from ._c_lanes import CProgram, c_program
from ._not_scalar import NotScalar, UnknownOperation
from ._one_loop import as_it_stands, bound, define
from ._plan import logger
from ._switch import may_call_c

in_lanes_p = Primitive("in_lanes")
# As fast as with -O2, which takes twice as long.
_FLAGS = "-std=gnu11 -O1 -fexpensive-optimizations -march=native -fno-math-errno -fno-trapping-math"
_FLAGS += " -fno-strict-aliasing -fPIC -shared"
_FEWEST = 4  # states from which on lanes are worth it


class Native(NamedTuple):
    """`target`, a foreign function's name; `constants`, its arguments behind the function's own."""

    target: str
    constants: tuple[np.ndarray, ...]


Function = TypeVar("Function", bound=Callable[..., Any])


def in_lanes(function: Function) -> Function:
    """`function`, to be mapped by `jax.vmap` over a batch: on a CPU, by a C program if there is a C compiler.

    For what is called often with the same shapes, such as a policy: the C compiler takes seconds, for every function
    and all numbers that are not arguments: pass a tree, and what changes, as arguments. Its programs are kept in the
    folder that the environment variable `JAXRMP_CACHE` names, by default `~/.cache/jaxrmp/c`. What cannot be said in C
    is mapped as usual, and the logger `jaxrmp.xla` says why; so are fewer than four states, derivatives, and what is
    written for other platforms or machines without a compiler. Products with numbers that are known to be zero are
    left out. What `jax.export` is to write has to be traced with `machinery(False)`.

    **Arguments**: `function`, of pytrees of arrays; keywords are taken as they are.
    **Returns** a function that gives the same.

    >>> squares = jax.jit(jax.vmap(in_lanes(lambda x: x @ x)))
    >>> squares(jnp.ones((8, 3))).shape
    (8,)
    """

    @functools.wraps(function)
    def laned(*arguments, **options):
        # Nothing is compiled where nothing is traced.
        if not may_call_c() or not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arguments)):
            return function(*arguments, **options)
        return bound(in_lanes_p, functools.partial(function, **options), arguments, places=None, size=0)

    return cast(Function, laned)


def _mapped(*values, jaxpr, places, call=as_it_stands, **_):
    function = functools.partial(call, jaxpr)
    return function(*values) if places is None else jax.vmap(function, in_axes=places)(*values)


def _shapes(*_values, jaxpr, places, size, **_):
    return [a if places is None else a.update(shape=(size, *a.shape)) for a in jaxpr.out_avals]


def _batch(values, dimensions, *, jaxpr, places, size, name):
    if places is not None:
        mapped = functools.partial(_mapped, jaxpr=jaxpr, places=places)
        return jax.vmap(mapped, in_axes=dimensions)(*values), [0] * len(jaxpr.out_avals)
    size = next(v.shape[d] for v, d in zip(values, dimensions, strict=True) if d is not None)
    found = in_lanes_p.bind(*values, jaxpr=jaxpr, places=tuple(dimensions), size=size, name=name)
    return found, [0] * len(found)


def _lower_on_cpu(context, *values, jaxpr, places, size, name):
    function = functools.partial(_mapped, jaxpr=jaxpr, places=places)
    if may_call_c() and places is not None and isinstance(size, int) and size >= _FEWEST:
        native = _native_of(jaxpr, tuple(p is not None for p in places), name)
        if native:
            function = functools.partial(_called, native=native, places=places, size=size, results=jaxpr.out_avals)
    return mlir.lower_fun(function, multiple_results=True)(context, *values)


def _called(*values, native, places, size, results):
    first = [v if k is None else jnp.moveaxis(v, k, 0) for v, k in zip(values, places, strict=True)]
    shapes = [jax.ShapeDtypeStruct((size, *a.shape), a.dtype) for a in results]
    return jax.ffi.ffi_call(native.target, shapes)(*first, *map(jnp.asarray, native.constants))


@functools.lru_cache(maxsize=256)
def program_of(jaxpr: ClosedJaxpr, mapped: tuple[bool, ...], name: str) -> tuple[CProgram | None, str]:
    """A function as C, or None and why not."""
    try:
        return c_program(jaxpr, mapped), ""
    except UnknownOperation as error:
        _say_once(error.name)
        return None, str(error)
    except NotScalar as error:
        logger.info("%s is not written in C: %s", name, error)
        return None, str(error)
    except Exception as error:  # of ours: a batch must not fail for what only makes it faster
        logger.warning("%s cannot be written in C, and runs slower; please report: %r", name, error)
        return None, repr(error)


@functools.cache
def _say_once(operation: str) -> None:
    """Of one that may be new to us, and by which policies run slower without any fault of theirs."""
    logger.warning("`%s` of JAX %s has no form in C here: what holds it runs slower.", operation, jax.__version__)


@functools.lru_cache(maxsize=256)
def _native_of(jaxpr: ClosedJaxpr, mapped: tuple[bool, ...], name: str) -> Native | None:
    """The C program for a batch of a function, compiled and known to XLA; None where there is none."""
    program, _ = program_of(jaxpr, mapped, name)
    if program is None:
        return None
    try:
        return Native(_registered(program.text), program.constants)
    except (OSError, subprocess.TimeoutExpired) as error:
        logger.warning("%s is not compiled as C, and runs slower: %s", name, error)
        return None


_known: set[str] = set()


def _registered(text: str) -> str:
    library = _compiled(text)
    target = f"jaxrmp_{library.stem}"
    if target in _known:
        return target
    try:
        handler = ctypes.CDLL(str(library)).program_ffi
    except (OSError, AttributeError):  # written by half
        library.unlink()
        handler = ctypes.CDLL(str(_compiled(text))).program_ffi
    jax.ffi.register_ffi_target(target, jax.ffi.pycapsule(handler), platform="cpu")
    _known.add(target)
    return target


def _compiled(text: str) -> Path:
    """The library of a C program; **raises** `OSError` where there is none to be had."""
    here = Path(__file__).parent
    headers = "".join((here / name).read_text() for name in ("lanes.h", "ffi.h"))
    mathematics = ["-lmvec", "-lm"] if platform.machine() == "x86_64" and platform.system() == "Linux" else ["-lm"]
    include = [f"-I{here}", f"-I{jax.ffi.include_dir()}"]
    return library_of(f'{text}\n#include "ffi.h"\n', _FLAGS, mathematics, include, f"{headers}\0{jax.__version__}")


define(in_lanes_p, _mapped, _shapes, _batch, _lower_on_cpu)
