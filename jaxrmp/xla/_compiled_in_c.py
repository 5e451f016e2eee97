"""Functions compiled by a C compiler for a loop that calls them from Python with one state after the other."""

import ctypes
import subprocess
import threading
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from .._errors import ExportError, ShapeError
from ._arguments import fitting
from ._c_compiler import library_of
from ._c_fields import HIT, Field, layout, struct
from ._c_single import single_program
from ._c_while import require_count
from ._not_scalar import NotScalar
from ._switch import machinery

_FLAGS = "-std=c99 -O3 -march=native -fno-math-errno -fPIC -shared"


class CompiledInC:
    """A `function` of arguments like `examples`, in C; what `compiled` returns for `backend="c"`.

    Any number of threads may call it; they take turns.
    """

    def __init__(self, function: Callable[..., Any], examples: tuple[Any, ...], max_iterations: int | None = None):
        require_count(max_iterations)
        with machinery(True):
            closed, shape = jax.make_jaxpr(function, return_shape=True)(*examples)
        self._structure = jax.tree.structure(examples)
        self._results = jax.tree.structure(shape)
        self._single = self._results == jax.tree.structure(0)
        self._turn = threading.Lock()
        inputs, outputs = (
            [Field(f"a{k}", tuple(a.shape), np.dtype(a.dtype)) for k, a in enumerate(avals)]
            for avals in (closed.in_avals, closed.out_avals)
        )
        try:
            program = single_program(closed, "program", inputs, outputs, max_iterations)
        except NotScalar as error:
            advice = "state max_iterations=N" if "stated count" in str(error) else "which has no form in C"
            raise ExportError(f'backend="c": the function {error}, {advice}.') from error
        if max_iterations is not None:
            outputs = [*outputs, HIT]
        self._most = max_iterations
        text = f"#include <stdint.h>\n{struct('program_in', inputs)}\n{struct('program_out', outputs)}\n{program.text}"
        try:
            library = ctypes.CDLL(str(library_of(text, _FLAGS, ["-lm"])))
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ExportError(f'backend="c": {error}') from error
        self._function = library.program
        self._function.argtypes, self._function.restype = [ctypes.c_void_p] * 2, None
        self._given, self._found = np.zeros((), layout(inputs)), np.zeros((), layout(outputs))
        self._memory = self._given.ctypes.data, self._found.ctypes.data
        self._slots = [(f.shape, f.dtype, self._given[f.name] if f.size else np.zeros(f.shape)) for f in inputs]
        self._values = [self._found[f.name] if f.size else np.zeros(f.shape, f.dtype) for f in outputs]

    def __call__(self, *arguments: Any) -> Any:
        leaves, structure = jax.tree.flatten(arguments)
        if structure != self._structure:
            raise ShapeError(f"the arguments are {structure}; this was compiled for {self._structure}.")
        with self._turn:
            for leaf, (shape, dtype, place) in zip(leaves, self._slots, strict=True):
                place[...] = fitting(leaf, shape, dtype)
            self._function(*self._memory)
            found = [value.copy() for value in self._values]
        if self._most is not None and found.pop():
            raise ExportError(f"a `while` was cut off after {self._most} steps: give a larger max_iterations.")
        return found[0] if self._single else jax.tree.unflatten(self._results, found)
