"""Policies as StableHLO, JAX's own portable form, which runs where only jax is installed."""

import importlib
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.export

from .._errors import ConfigurationError, UnknownNameError, importing
from .._files import atomic_write
from ..xla import machinery
from ._fields import shape_of

PLATFORMS = ("cpu", "cuda", "rocm", "tpu")
_WITH_PYTREES = ("learning", "policies", "simulation")  # parts whose pytrees programs take, beside those always there


def stablehlo(function: Callable[..., Any], *examples: Any, platforms: Sequence[str] = ("cpu",)) -> bytes:
    """A program of StableHLO that computes `function` of arguments with the shapes and types of `examples`.

    What the function holds, such as a skill's weights, is in the program; it is the mathematics as written
    (`jaxrmp.xla.machinery(False)`), with no call of anything outside it. Where only jax and flatbuffers are installed,
    `jax.export.deserialize(content).call` runs it, if arguments and results are arrays, and tuples, lists and dicts of
    them; with jaxrmp's own pytrees among them, such as a `World`, `load_stablehlo` does.

    **Arguments**: `function`, of arrays and pytrees of arrays; `examples`, its arguments, whose values do not matter;
    `platforms`, of "cpu", "cuda", "rocm" and "tpu", those that it is to run on.
    **Returns** the program, readable by JAX for half a year at least.
    **Raises** `ConfigurationError` where arguments or results hold what cannot be written, `UnknownNameError` for
    another platform, `MissingDependencyError` where flatbuffers is not installed.

    >>> import jaxrmp
    >>> import numpy as np
    >>> from jaxrmp.leaves import Posture
    >>> q = np.zeros(2, np.float32)
    >>> content = stablehlo(lambda q, qd: jaxrmp.acceleration(Posture(0 * q, stiffness=4.0), q, qd), q, q)
    >>> jax.export.deserialize(bytearray(content)).call(q + 1, q).round(3).tolist()
    [-4.0, -4.0]
    """
    _require_flatbuffers()
    for platform in platforms:
        UnknownNameError.check("platform", platform, PLATFORMS)
    shapes = jax.tree.map(shape_of, examples)
    with machinery(False):
        exported = jax.export.export(jax.jit(function), platforms=tuple(platforms))(*shapes)
    try:
        return bytes(exported.serialize())
    except ConfigurationError:
        raise
    except (TypeError, ValueError) as error:
        raise ConfigurationError(
            f"arguments or results cannot be written: {error} Expected arrays, and tuples, lists, dicts by text and "
            "jaxrmp's pytrees of them."
        ) from error


def write_stablehlo(
    path: str | os.PathLike, function: Callable[..., Any], *examples: Any, platforms: Sequence[str] = ("cpu",)
) -> Path:
    """Write what `stablehlo` returns to the file `path`, which appears whole or not at all.

    **Arguments**: `function`, `examples` and `platforms` as in `stablehlo`; **raises** as that.
    """
    content, path = stablehlo(function, *examples, platforms=platforms), Path(path)
    with atomic_write(path) as file:
        file.write(content)
    return path


def load_stablehlo(source: str | os.PathLike | bytes) -> Callable[..., Any]:
    """The function of a file that `write_stablehlo` wrote, or of the bytes of `stablehlo`, `source`: jitted, of the
    same arguments.

    **Raises** `ConfigurationError` if it is no such program, or a class of its arguments is not there;
    `MissingDependencyError` where flatbuffers is not installed.
    """
    _require_flatbuffers()
    for part in _WITH_PYTREES:
        importlib.import_module(f"jaxrmp.{part}")
    content = source if isinstance(source, bytes) else Path(source).read_bytes()
    try:
        exported = jax.export.deserialize(bytearray(content))
    except Exception as error:  # flatbuffers' own errors of what is no such file are of many types
        what = "the content" if isinstance(source, bytes) else repr(str(source))
        raise ConfigurationError(f"{what} is no program that stablehlo wrote, or not one of now: {error}") from error
    return jax.jit(exported.call)


def _require_flatbuffers() -> None:
    with importing("flatbuffers", "export"):
        import flatbuffers  # noqa: F401  # type: ignore[import-not-found]
