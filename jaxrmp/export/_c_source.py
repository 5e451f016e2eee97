"""A policy as one C99 source file and its header."""

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax

from .._errors import ConfigurationError, ExportError
from .._files import atomic_write
from .._version import __version__
from ..xla import HIT, Field, NotScalar, Single, layout, machinery, require_count, single_program, struct
from ._fields import argument_names, comment, fields, function_identifier, shape_of


class CSource(NamedTuple):
    """A function as C, by its `name`: `source` and `header`, the text of `NAME.c` and `NAME.h`.

    `inputs` and `outputs`, the fields of `NAME_in` and `NAME_out`; `fingerprint`, which differs if anything that is
    computed differs; `stack`, bytes of working memory; `operations`, on single numbers.
    """

    name: str
    source: str
    header: str
    inputs: tuple[Field, ...]
    outputs: tuple[Field, ...]
    fingerprint: str
    stack: int
    operations: int

    def write(self, folder: str | os.PathLike) -> tuple[Path, Path]:
        """Write `NAME.c` and `NAME.h` into a `folder`, which is made if it is not there; what was there is replaced.

        **Returns** the two. **Raises** `OSError`.
        """
        return tuple(write_text(Path(folder) / f"{self.name}{end}", text) for end, text in self._files())  # type: ignore

    def _files(self) -> tuple[tuple[str, str], ...]:
        return (".c", self.source), (".h", self.header)


def write_text(file: Path, text: str) -> Path:
    """Write a text file as a whole or not at all. **Returns** it. **Raises** `OSError`."""
    with atomic_write(file) as opened:
        opened.write(text.encode())
    return file


def c(
    function: Callable[..., Any],
    *examples: Any,
    name: str = "policy",
    names: Sequence[str] | None = None,
    units: Mapping[str, str] | None = None,
    about: str = "",
    max_iterations: int | None = None,
) -> CSource:
    """A function of arrays, such as a policy, as C99 that needs a C compiler and its mathematical functions alone.

    `void NAME(const NAME_in *in, NAME_out *out)` computes what `function` gives. It allocates nothing, keeps nothing
    between calls, and every loop in it has a fixed number of steps: so any number of threads may call it, and a call
    takes about the same time whatever the state. All that is no argument is a constant of the file. Arguments have to
    be finite: products with constant zeros are left out, and with them what is not a number.

    **Arguments**: `function`, of pytrees of arrays; `examples`, its arguments: their values do not matter,
    and `jax.ShapeDtypeStruct` will do. Numbers are `float`, or `double` if the examples are so and `jax_enable_x64` is
    on. `name`, of the function, in C; `names` of its arguments, by default the function's own: an argument that is a
    pytree becomes a field for each of its arrays, such as `world_spheres_center`; a result that is a dict, a field for
    each of its entries, and one array the field `result`. `units`, by the name of an argument, a field or a result,
    what its comment says, such as `{"q": "rad"}`; `about`, a line for the head of the file. `max_iterations`, steps
    that a `while` may take, such as Lula's projection, which takes 50 at most: then the last result is `bound_hit`,
    how many loops were cut off there, and if it is not 0, results are not those of the function.
    **Returns** a `CSource`, whose `write` makes the files.
    **Raises** `ExportError` for an operation that has no form in C, which it names with the leaf it is in, such as a
    sort, or a `while` if no `max_iterations` is stated; for numbers of several precisions; or for what takes more than
    1 MiB of working memory. `ConfigurationError` for names that are too few, or the same, and a `max_iterations` that
    is no whole number from 1 on.

    >>> import jaxrmp
    >>> import numpy as np
    >>> from jaxrmp.leaves import Posture
    >>> q = np.zeros(2, np.float32)
    >>> policy = lambda rest, q, qd: jaxrmp.acceleration(Posture(rest, stiffness=4.0), q, qd)
    >>> found = jaxrmp.export.c(policy, q, q, q, name="posture", units={"q": "rad"})
    >>> [field.name for field in found.inputs], "float q[2]; /* rad */" in found.header
    (['rest', 'q', 'qd'], True)
    """
    require_count(max_iterations)
    name, units = function_identifier(name), units or {}
    with machinery(True):
        closed, shape = jax.make_jaxpr(function, return_shape=True)(*examples)
    called = dict(zip(argument_names(function, len(examples), names), examples, strict=False))
    inputs = fields({given: jax.tree.map(shape_of, example) for given, example in called.items()}, units)
    outputs = fields({"result" if isinstance(shape, jax.ShapeDtypeStruct) else "": shape}, units)
    for fields_of, what in ((inputs, "takes"), (outputs, "gives")):
        if not any(field.size for field in fields_of):
            raise ExportError(f"{name} {what} no numbers, and a struct in C cannot be empty.")
    program = _program(closed, name, inputs, outputs, max_iterations)
    if max_iterations is not None:
        if any(field.name == HIT.name for field in outputs):
            raise ConfigurationError(f"a result is called {HIT.name!r}, as the one that max_iterations adds.")
        outputs = (*outputs, HIT)
    structs = f"{struct(f'{name}_in', inputs)}\n\n{struct(f'{name}_out', outputs)}"
    fingerprint = hashlib.sha256(f"{structs}\n{program.text}".encode()).hexdigest()[:16]
    about = f"{comment(about)}\n   " if about else ""
    head = f"/* {about}Written by jaxrmp {__version__}. Fingerprint {fingerprint}. */"
    source = f'{head}\n\n#include "{name}.h"\n{program.text}'
    header = _header(name, inputs, outputs, fingerprint, program, about)
    return CSource(name, source, header, inputs, outputs, fingerprint, program.stack, program.operations)


def _program(closed: Any, name: str, inputs: Sequence[Field], outputs: Sequence[Field], most: int | None) -> Single:
    try:
        return single_program(closed, name, inputs, outputs, most)
    except NotScalar as error:
        raise ExportError(f"{name} cannot be written in C: {_says(error, _place(error))}") from error


def _says(error: NotScalar, place: str) -> str:
    """An error as what a function does, where, and what would help."""
    text = str(error)
    does = text if text.startswith(("holds", "takes")) else f"takes {text}" if "operations" in text else f"holds {text}"
    where = f", in {place}" if place else ""
    if "stated count" in text:
        return (
            f"it holds `while`{where}, whose steps have to be bounded: state how many it may take at most, by "
            "max_iterations=N, or on the command line --while-count N."
        )
    advice = (
        "Give it fewer obstacles or spheres, or leave out the certificate."
        if text.startswith("takes") or "operations" in text
        else "C is written of arithmetic, sums, products, choices by `where`, and entries taken by indices that are "
        "known beforehand."
    )
    return f"it {does}{where}. {advice}"


def _place(error: NotScalar) -> str:
    """Where in the code an error arose: from inside out, up to the first method of a class, such as a leaf's."""
    own, machinery_ = os.path.dirname(jax.__file__), str(Path(__file__).parent.parent / "xla")
    for equation in error.within:
        traceback = equation.source_info.traceback
        frames = [f for f in (traceback.frames if traceback else ()) if not f.file_name.startswith((own, machinery_))]
        if frames:
            last = next((k for k, f in enumerate(frames) if "." in f.function_name.partition(".<")[0]), 0)
            chosen = frames[: last + 1] if last < 4 else frames[:1]
            return " in ".join(f"{f.function_name} ({Path(f.file_name).name}, line {f.line_num})" for f in chosen)
    return ""


_HEADER = """\
/* {about}Written by jaxrmp {version}.

   void {name}(const {name}_in *in, {name}_out *out) computes *out of *in: no memory is allocated, nothing is kept
   between calls, and every loop has a fixed number of steps. Arrays are row by row. */

#ifndef {upper}_H
#define {upper}_H

#include <stdint.h>

#define {upper}_VERSION "{version}"
#define {upper}_FINGERPRINT "{fingerprint}"
#define {upper}_STACK {stack} /* bytes of working memory, on the stack */

#ifdef __cplusplus
extern "C" {{
#endif

{structs}

/* The structs are laid out as this file was written for. */
typedef char {name}_in_has_its_size[sizeof({name}_in) == {in_size} ? 1 : -1];
typedef char {name}_out_has_its_size[sizeof({name}_out) == {out_size} ? 1 : -1];

void {name}(const {name}_in *in, {name}_out *out);

#ifdef __cplusplus
}}
#endif

#endif
"""


def _header(
    name: str, inputs: Sequence[Field], outputs: Sequence[Field], fingerprint: str, program: Single, about: str
) -> str:
    return _HEADER.format(
        about=about,
        version=__version__,
        name=name,
        upper=name.upper(),
        fingerprint=fingerprint,
        stack=program.stack,
        structs=f"{struct(f'{name}_in', inputs)}\n\n{struct(f'{name}_out', outputs)}",
        in_size=layout(inputs).itemsize,
        out_size=layout(outputs).itemsize,
    )
