"""Policies compiled for a control loop: called from Python with one state after the other, as fast as JAX allows.

Two things cost more there than a policy's arithmetic. JAX takes one to two microseconds to receive a NumPy array; so
all of them travel as one. And XLA:CPU runs a program as some hundred kernels, one after the other; so it is told to
make a single one of the whole, as it does of its own accord for small loops.
"""

import functools
import threading
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, overload

import jax
import numpy as np
from jax.experimental.xla_metadata import set_xla_metadata

from .._errors import ConfigurationError, ShapeError, UnknownNameError
from ._arguments import fitting
from ._compiled_in_c import CompiledInC
from ._plan import logger
from ._switch import is_on, one_kernel

_ONE_KERNEL = functools.partial(set_xla_metadata, inlineable="false", xla_cpu_small_call="true")
_OPTIONS = {"xla_cpu_experimental_ynn_fusion_type": ""}  # matrix products as calls do not go into a kernel


class _Slot(NamedTuple):
    """Where an argument that is a NumPy array or a number travels: in which buffer, and from where on."""

    shape: tuple[int, ...]
    dtype: np.dtype
    buffer: int
    start: int

    @property
    def size(self) -> int:
        return int(np.prod(self.shape))

    def of(self, buffer: Any) -> Any:
        """The argument in its buffer."""
        return buffer[self.start : self.start + self.size].reshape(self.shape)


class Compiled:
    """A compiled `function` of arguments with the shapes and types of `examples`; what `compiled` returns.

    Any number of threads may call it; they take turns. `one_kernel` says whether XLA made one kernel of the program,
    and `reason` why not.
    """

    one_kernel: bool
    reason: str

    def __init__(self, function: Callable[..., Any], examples: tuple[Any, ...]):
        leaves, self._structure = jax.tree.flatten(examples)
        slots, self._buffers = _laid_out(leaves)
        self._slots = [slot and (slot.shape, slot.dtype, slot.of(self._buffers[slot.buffer])) for slot in slots]
        self._turn = threading.Lock()

        def unpacked(*given: jax.Array) -> Any:
            on_device = iter(given[len(self._buffers) :])
            values = [slot.of(given[slot.buffer]).astype(slot.dtype) if slot else next(on_device) for slot in slots]
            return function(*jax.tree.unflatten(self._structure, values))

        on_device = [leaf for leaf, slot in zip(leaves, slots, strict=True) if slot is None]
        self._program, self.reason = _compiled(unpacked, *self._buffers, *on_device)
        self.one_kernel = not self.reason

    def __call__(self, *arguments: Any) -> Any:
        leaves, structure = jax.tree.flatten(arguments)
        if structure != self._structure:
            raise ShapeError(f"the arguments are {structure}; this was compiled for {self._structure}.")
        on_device = []
        with self._turn:
            for leaf, slot in zip(leaves, self._slots, strict=True):
                if slot is None:
                    on_device.append(leaf)
                    continue
                shape, dtype, place = slot
                place[...] = fitting(leaf, shape, dtype)
            found = self._program(*self._buffers, *on_device)
            # Waits for the result: only then may the next arguments be written over these.
            return np.asarray(found) if isinstance(found, jax.Array) else jax.tree.map(np.asarray, found)


@overload
def compiled(function: Callable[..., Any], *examples: Any, backend: Literal["xla"] = "xla") -> Compiled: ...
@overload
def compiled(
    function: Callable[..., Any], *examples: Any, backend: Literal["c"], max_iterations: int | None = None
) -> CompiledInC: ...
def compiled(
    function: Callable[..., Any],
    *examples: Any,
    backend: Literal["xla", "c"] = "xla",
    max_iterations: int | None = None,
) -> Compiled | CompiledInC:
    """Compile `function` for a loop that calls it from Python with one state after the other.

    The fastest way to call a policy that is not batched: half the time of a function made by `jax.jit`, or less.
    Nothing is traced or compiled again: other shapes or types are errors. On a CPU the whole program is one kernel on
    one core, its matrix products plain loops: right for a policy, and wrong for a batch, a rollout or a large network,
    which are for `jax.jit`.

    **Arguments**: `function`, of arrays and pytrees of arrays; `examples`, its arguments as the loop will pass them:
    their values do not matter, and `jax.ShapeDtypeStruct` will do. NumPy arrays and numbers travel together, in JAX's
    precision. Where an example is a JAX array, the loop passes one, too, which stays on its device: for what is large
    and seldom changes. `backend`, "xla", or "c": faster still, for what C can say (`jaxrmp.export.c`), where there is a
    C compiler, which takes some seconds, once: programs are kept in the folder that `JAXRMP_CACHE` names.
    `max_iterations`, for "c", steps that a `while` may take, such as Lula's projection, which takes 50 at most.
    **Returns** a function of such arguments that returns NumPy arrays, which are not to be written to. It **raises**
    `ShapeError` for arguments of other shapes or types, and for "c" `ExportError` where a `while` takes more steps.
    **Raises** `TypeError` if an example holds what is no array; for "c", `ExportError` for what has no form in C, and
    where there is no compiler.

    >>> import jaxrmp
    >>> from jaxrmp.leaves import Posture
    >>> q = np.zeros(2, np.float32)
    >>> policy = jaxrmp.compiled(lambda rest, q, qd: jaxrmp.acceleration(Posture(rest, stiffness=4.0), q, qd), q, q, q)
    >>> policy(np.array([0.5, 0.0], np.float32), q, q).shape
    (2,)
    """
    UnknownNameError.check("backend", backend, ("xla", "c"))
    if backend == "c":
        return CompiledInC(function, examples, max_iterations)
    if max_iterations is not None:
        raise ConfigurationError('max_iterations is for backend="c"; XLA runs a `while` as it is.')
    return Compiled(function, examples)


def _laid_out(leaves: Sequence[Any]) -> tuple[list[_Slot | None], list[np.ndarray]]:
    """The slot of each argument, None if it stays on the device, and a buffer for each type of number."""
    types = [None if isinstance(leaf, jax.Array) else _type_of(leaf) for leaf in leaves]
    carriers = list(dict.fromkeys(dtype for dtype in types if dtype is not None and dtype.kind != "b"))
    carriers = carriers or [np.dtype(bool)]  # beside numbers, flags travel as such
    sizes = [0] * len(carriers)
    slots: list[_Slot | None] = []
    for leaf, dtype in zip(leaves, types, strict=True):
        if dtype is None:
            slots.append(None)
            continue
        buffer = carriers.index(dtype) if dtype in carriers else 0
        slot = _Slot(np.shape(leaf), dtype, buffer, sizes[buffer])
        sizes[buffer] += slot.size
        slots.append(slot)
    return slots, [np.zeros(size, carrier) for size, carrier in zip(sizes, carriers, strict=True)]


def _type_of(leaf: Any) -> np.dtype:
    dtype = getattr(leaf, "dtype", None) or np.asarray(leaf).dtype
    if np.dtype(dtype).kind not in "biufc":
        raise TypeError(f"an example holds {leaf!r}, of type {type(leaf).__name__}: expected arrays and numbers.")
    return np.dtype(jax.dtypes.canonicalize_dtype(dtype))


def _compiled(function: Callable[..., Any], *arguments: Any) -> tuple[Callable[..., Any], str]:
    """The program, and why it is not one kernel: what XLA:CPU cannot put into one, it compiles as it always does."""
    inner, reason = jax.jit(function), ""
    if jax.default_backend() != "cpu":
        reason = f"made for a CPU; this is a {jax.default_backend()}"
    elif not is_on():
        reason = "the machinery is off"
    else:
        whole = jax.jit(lambda *a: jax.tree.map(_ONE_KERNEL, inner(*a)), compiler_options=_OPTIONS)
        try:
            with one_kernel():
                return whole.lower(*arguments).compile(), ""
        except jax.errors.JaxRuntimeError as error:
            reason = str(error)
            logger.info("%s is not one kernel: %s", getattr(function, "__qualname__", function), reason)
    return inner.lower(*arguments).compile(), reason
