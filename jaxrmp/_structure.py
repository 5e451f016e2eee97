"""The static fields of pytrees as bytes and back, so that `jax.export` can write what takes and returns pytrees."""

import dataclasses
import importlib
import json
import math
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from ._errors import ConfigurationError

_VALUES = (str, int, float, type(None))  # which JSON holds as they are; bool is an int
_NAN = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


def structure_to_bytes(structure: Any) -> bytes:
    """Texts, numbers, tuples, lists and mappings of them, named tuples and dataclasses, as JSON.

    **Raises** `ConfigurationError` for anything else, such as a function.
    """
    return json.dumps(_written(structure)).encode()


def structure_from_bytes(content: bytes | bytearray) -> Any:
    """What `structure_to_bytes` wrote, equal to it. No class is looked for but jaxrmp's and those already imported.

    **Raises** `ConfigurationError` for a class that is not there, or has other fields now.
    """
    # The same object for every NaN: a tuple with it equals another with it, as the trees of pytrees must.
    return _read(json.loads(content, parse_constant=_NAN.__getitem__))


def _written(value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, _VALUES):
        return value
    if isinstance(value, list):
        return {"list": [_written(v) for v in value]}
    if isinstance(value, Mapping):
        return {"mapping": [[_written(k), _written(v)] for k, v in value.items()]}
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return [_written(v) for v in value]
    if isinstance(value, type) or not (names := _fields(type(value))):
        raise ConfigurationError(
            f"a static field holds {value!r}, of type {type(value).__name__}, which cannot be written to a file: "
            "expected texts, numbers, and tuples and dataclasses of them."
        )
    return {
        "of": f"{type(value).__module__}:{type(value).__qualname__}",
        "fields": {n: _written(getattr(value, n)) for n in names},
    }


def _read(content: Any) -> Any:
    if isinstance(content, list):
        return tuple(_read(v) for v in content)
    if not isinstance(content, dict):
        return content
    if "list" in content:
        return [_read(v) for v in content["list"]]
    if "mapping" in content:
        return {_read(k): _read(v) for k, v in content["mapping"]}
    kind, given = _class(content["of"]), content["fields"]
    if set(given) != set(_fields(kind)):
        raise ConfigurationError(f"{kind.__name__} has {sorted(_fields(kind))}, but the file {sorted(given)}.")
    values = {name: _read(v) for name, v in given.items()}
    if issubclass(kind, tuple):
        return kind(**values)
    made = object.__new__(kind)  # what was checked about a user's arguments holds
    made.__dict__.update(values)
    return made


def _fields(kind: type) -> tuple[str, ...]:
    """Names of the fields of a named tuple or of a dataclass, none of anything else."""
    if dataclasses.is_dataclass(kind):
        return tuple(f.name for f in dataclasses.fields(kind))
    return tuple(getattr(kind, "_fields", ())) if issubclass(kind, tuple) else ()


def _class(name: str) -> Any:
    module, _, qualified = name.partition(":")
    found = sys.modules.get(module)
    if found is None and module.partition(".")[0] == __package__:
        found = importlib.import_module(module)
    for part in qualified.split("."):
        found = getattr(found, part, None)
    if not isinstance(found, type) or not _fields(found):
        raise ConfigurationError(f"{name} is no class that is there: import its module before the file is read.")
    return found
