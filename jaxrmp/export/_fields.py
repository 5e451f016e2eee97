"""Arguments and results of a function as fields of C structs: what they are called."""

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from .._errors import ConfigurationError
from ..xla import Field

# Not all words of C and C++ alone: what <math.h> and <stdint.h> name does not matter for a field.
_WORDS = frozenset(
    "auto bool break case catch char class const continue default delete do double else enum extern false float for "  # noqa: SIM905
    "friend goto if inline int long namespace new operator private protected public register restrict return short "
    "signed sizeof static struct switch template this throw true try typedef typename union unsigned using virtual "
    "void volatile while".split()
)


def identifier(text: str) -> str:
    """The name in C that is closest to a text."""
    found = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_") or "value"
    return f"{found}_" if found in _WORDS else f"_{found}"[found[0].isalpha() :]


def argument_names(function: Callable[..., Any], count: int, given: Sequence[str] | None) -> tuple[str, ...]:
    """A name for each of `count` arguments: those `given`, or the function's own.

    **Raises** `ConfigurationError` if another number of them is given.
    """
    if given is not None:
        if len(given) != count:
            raise ConfigurationError(f"names is {tuple(given)}, expected one for each of {count} examples.")
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
            note = units.get(name, units.get(tree, ""))
            found[name] = Field(name, tuple(leaf.shape), np.dtype(leaf.dtype), note)
    return tuple(found.values())


def _part(key: Any) -> str:
    """A key of a pytree's path, as in a name."""
    for attribute in ("name", "key", "idx"):
        if hasattr(key, attribute):
            return str(getattr(key, attribute))
    return str(key)
