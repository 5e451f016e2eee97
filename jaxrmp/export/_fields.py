"""Arguments and results of a function as fields of C structs: what they are called."""

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from .._errors import ConfigurationError
from ..xla import Field

# Words of C and C++, macros, and names of the file's own; for the function's name, what <math.h> declares, too.
_WORDS = frozenset(
    "auto bool break case catch char class const continue default delete do double else enum extern false float for "  # noqa: SIM905
    "friend goto if inline int long namespace new operator private protected public register restrict return short "
    "signed sizeof static struct switch template this throw true try typedef typename union unsigned using virtual "
    "void volatile while main R N F LAST INDEPENDENT NAN INFINITY HUGE_VAL HUGE_VALF".split()
)
_MATHEMATICS = frozenset(
    f"{name}{end}"
    for name in (
        "acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs fdim floor "  # noqa: SIM905
        "fma fmax fmin fmod frexp hypot ilogb ldexp lgamma llrint llround log log10 log1p log2 logb lrint lround "
        "modf nan nearbyint nextafter pow remainder remquo rint round scalbln scalbn sin sinh sqrt tan tanh "
        "tgamma trunc".split()
    )
    for end in ("", "f", "l")
) | {"j0", "j1", "jn", "y0", "y1", "yn", "gamma", "program"}


def identifier(text: str) -> str:
    """The name in C that is closest to a text."""
    found = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_") or "value"
    return f"{found}_" if found in _WORDS else f"_{found}"[found[0].isalpha() :]


def function_identifier(text: str) -> str:
    """The name of a function in C that is closest to a text, and that no header which it needs declares."""
    found = identifier(text)
    return f"{found}_" if found in _MATHEMATICS else found


def comment(text: str) -> str:
    """A text that a comment in C can hold."""
    return text.replace("*/", "* /")


def shape_of(example: Any) -> jax.ShapeDtypeStruct:
    """Shape and type of an argument, in JAX's precision."""
    dtype = getattr(example, "dtype", None) or np.asarray(example).dtype
    return jax.ShapeDtypeStruct(np.shape(example), jax.dtypes.canonicalize_dtype(dtype))


def argument_names(function: Callable[..., Any], count: int, given: Sequence[str] | None) -> tuple[str, ...]:
    """A name for each of `count` arguments: those `given`, or the function's own.

    **Raises** `ConfigurationError` if another number of them is given, or one twice.
    """
    if given is not None:
        if len(given) != count:
            raise ConfigurationError(f"names is {tuple(given)}, expected one for each of {count} examples.")
        if len(set(given)) < count:
            raise ConfigurationError(f"names is {tuple(given)}, expected each once.")
        return tuple(given)
    try:
        own = [p.name for p in inspect.signature(function).parameters.values() if p.kind < p.VAR_POSITIONAL]
    except (TypeError, ValueError):
        own = []
    return tuple(own[k] if k < len(own) else f"argument_{k}" for k in range(count))


def fields(named: Mapping[str, Any], units: Mapping[str, str]) -> tuple[Field, ...]:
    """The arrays of pytrees as fields, each named after its tree and its place in it.

    **Arguments**: `named`, pytrees of what has a shape and a dtype; `units`, notes for fields by their name, or that of
    their tree. **Raises** `ConfigurationError` for two of the same name.
    """
    found: dict[str, Field] = {}
    for tree, value in named.items():
        for path, leaf in jax.tree_util.tree_flatten_with_path(value)[0]:
            name = identifier("_".join([tree, *map(_part, path)]) if tree else "_".join(map(_part, path)))
            if name in found:
                raise ConfigurationError(f"names: two arrays are called {name!r}; give their arguments other names.")
            note = comment(units.get(name, units.get(tree, "")))
            found[name] = Field(name, tuple(leaf.shape), np.dtype(leaf.dtype), note)
    return tuple(found.values())


def _part(key: Any) -> str:
    """A key of a pytree's path, as in a name."""
    for attribute in ("name", "key", "idx"):
        if hasattr(key, attribute):
            return str(getattr(key, attribute))
    return str(key)
