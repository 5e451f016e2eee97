"""Frozen dataclasses that JAX sees as pytrees.

A field is a parameter (an array, a number, or another pytree) unless it is marked `static()`. Static fields
become part of the compiled program: they must be hashable, so tuples rather than NumPy arrays.
"""

import dataclasses
import functools
import operator
from typing import Any, TypeVar, dataclass_transform

import jax
import jax.export
import numpy as np

from ._ranges import with_ranges
from ._structure import structure_from_bytes, structure_to_bytes

T = TypeVar("T")
_FLATTENED = "_flattened"
_named: set[str] = set()


def static(**kwargs: Any) -> Any:
    """Mark a field of a `pytree` class as structure rather than parameter; `**kwargs` are `dataclasses.field`'s."""
    return dataclasses.field(metadata={"static": True}, **kwargs)


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(static, dataclasses.field))
def pytree(cls: type[T]) -> type[T]:
    """Make `cls` a frozen dataclass and register it with JAX.

    What a value is made of is what `dataclasses.fields` names: beside those, its `__dict__` keeps what flattening it
    found. Fields that declare a range, as `Positive` does, are checked. Unflattening goes round `__init__`: JAX
    rebuilds values with placeholders where arrays were, and what is checked about a user's arguments does not hold
    for those.
    """
    cls = dataclasses.dataclass(frozen=True, eq=False)(with_ranges(cls))
    fields = dataclasses.fields(cls)  # type: ignore[arg-type]
    parameters = tuple(f.name for f in fields if not f.metadata.get("static"))
    structure = tuple(f.name for f in fields if f.metadata.get("static"))
    keys = tuple(jax.tree_util.GetAttrKey(name) for name in parameters)

    def flatten(value):
        content = value.__dict__
        return tuple(content[name] for name in parameters), tuple(content[name] for name in structure)

    # JAX flattens a tree on every call of a compiled function: a frozen value need work out its parts only once.
    flattened = functools.cached_property(flatten)
    flattened.__set_name__(cls, _FLATTENED)
    setattr(cls, _FLATTENED, flattened)

    def flatten_with_keys(value):
        children, aux = flatten(value)
        return tuple(zip(keys, children, strict=True)), aux

    def unflatten(aux, children):
        value = object.__new__(cls)
        value.__dict__.update(zip(parameters, children, strict=True))
        value.__dict__.update(zip(structure, aux, strict=True))
        return value

    jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, operator.attrgetter(_FLATTENED))
    _name_in_files(cls)
    return cls


def _name_in_files(cls: type) -> None:
    """Tell `jax.export` how to write values of `cls` where a program takes or returns them.

    JAX has one class for a name, and keeps it: one that is defined again, as by a notebook's cell, is not told.
    """
    name = f"{cls.__module__}.{cls.__qualname__}"
    if name in _named:
        return
    _named.add(name)
    jax.export.register_pytree_node_serialization(
        cls,
        serialized_name=name,
        serialize_auxdata=structure_to_bytes,
        deserialize_auxdata=structure_from_bytes,
    )


def as_pytree(function: Any) -> Any:
    """A function that may stand in a field: itself if it is a pytree, else in a `jax.tree_util.Partial`.

    So it can be an argument of compiled functions, which are compiled anew for another function.
    """
    return jax.tree_util.Partial(function) if jax.tree_util.all_leaves([function]) else function


def as_floats(value: Any) -> Any:
    """A JAX array as it is, and all else as a NumPy array of floats."""
    return value if isinstance(value, jax.Array) else np.asarray(value, float)


def set_field(value: Any, name: str, content: Any) -> None:
    """Assign a field of a frozen value; only for use inside its own `__post_init__`."""
    object.__setattr__(value, name, content)
    value.__dict__.pop(_FLATTENED, None)


def single(tree: Any) -> Any:
    """The same tree as NumPy arrays, its numbers in single precision: so that values can change without compiling."""
    return jax.tree.map(lambda a: np.asarray(a, bool if np.asarray(a).dtype == bool else np.float32), tree)
