"""Configurations as TOML files and as plain data: read with every mistake named, and written back."""

import dataclasses
import json
import tomllib
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .._errors import ConfigurationError, UnknownNameError
from ._configuration import Configuration


def _examples() -> Path:
    """The folder of examples: in the installed package, or of the clone that it is installed from."""
    package = Path(__file__).parents[1]
    return folder if (folder := package / "configs").is_dir() else package.parent / "configs"


def _example(named: str) -> Path | None:
    """The file of the example `named`; None where that is no plain name, or a file."""
    file = _examples() / f"{named}.toml"
    return file if named.isidentifier() and not Path(named).is_file() and file.is_file() else None


def load_configuration(path: str | Path, overrides: Mapping[str, Any] | None = None) -> Configuration:
    """Read the TOML configuration at `path`, or one of the examples, by its name alone, such as "drawer_closing". A
    robot file in it is found from its folder. `overrides` are values by dotted key, such as
    `{"metric.updates": 500, "subtasks.gripper.frame": "panda_hand"}`.

    **Raises** `ConfigurationError` if the file is missing or unreadable, or a value has the wrong type;
    `UnknownNameError` for a key that is not known.
    """
    path = _example(str(path)) or path
    try:
        content = tomllib.loads(Path(path).read_text())
    except OSError as error:
        names = ", ".join(sorted(file.stem for file in _examples().glob("*.toml")))
        raise ConfigurationError(
            f"cannot read configuration {str(path)!r}: {error.strerror}. Examples, by their names alone: {names}."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"configuration {str(path)!r} is no valid TOML: {error}.") from error
    robot = content.get("robot")
    if isinstance(robot, str) and robot != "panda":
        content["robot"] = str((Path(path).parent / robot).resolve())
    for key, value in (overrides or {}).items():
        *sections, last = key.split(".")
        table: Any = content
        for section in sections:
            if isinstance(table, list):  # of named tables, as `subtasks` is
                named = {str(entry["name"]): entry for entry in table if isinstance(entry, dict) and "name" in entry}
                UnknownNameError.check("subtask", section, named)
                table = named[section]
                continue
            table = table.setdefault(section, {})
            if not all(isinstance(entry, dict) for entry in (table if isinstance(table, list) else [table])):
                raise ConfigurationError(f"{key!r} does not name a value: {section!r} is no section.")
        if isinstance(table, list):
            raise ConfigurationError(f"{key!r} does not name a value: {last!r} is a section.")
        table[last] = value
    return configuration_from_dict(content)


def configuration_from_dict(content: Mapping[str, Any]) -> Configuration:
    """A `Configuration` from the dictionaries of TOML or a skill file, `content`. Raises as `load_configuration`."""
    return _build(Configuration, dict(content), "")


def _build(kind: Any, value: Any, where: str) -> Any:
    """Turn plain data into the annotated type `kind`, or say what does not fit."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is types.UnionType:  # a section of keys or a list
        section = isinstance(value, Mapping)
        fitting = [k for k in arguments if (typing.get_origin(k) is Mapping) == section]
        return _build((fitting or arguments)[0], value, where)
    if dataclasses.is_dataclass(kind):
        if not isinstance(value, Mapping):
            raise ConfigurationError(f"{where} is {value!r}, expected a section of keys.")
        types_of = typing.get_type_hints(kind)
        known = [f.name for f in dataclasses.fields(kind)]
        for key in value:
            UnknownNameError.check(f"configuration key in {where or 'the configuration'}", key, known)
        prefix = f"{where}." if where else ""
        for f in dataclasses.fields(kind):
            required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
            if required and f.name not in value:
                raise ConfigurationError(f"{prefix}{f.name} is missing.")
        return kind(**{key: _build(types_of[key], v, prefix + key) for key, v in value.items()})  # type: ignore[operator]
    if origin is tuple and isinstance(value, list | tuple):
        if arguments[-1] is not Ellipsis and len(value) != len(arguments):
            raise ConfigurationError(f"{where} is {value!r}, expected {len(arguments)} entries.")
        kinds = [arguments[0]] * len(value) if arguments[-1] is Ellipsis else arguments
        return tuple(_build(k, v, f"{where}[{i}]") for i, (k, v) in enumerate(zip(kinds, value, strict=True)))
    if origin is Mapping:
        if isinstance(value, Mapping):
            return {str(k): _build(arguments[1], v, f"{where}.{k}") for k, v in value.items()}
    elif origin is typing.Literal or (kind is str and isinstance(value, str)):
        return value
    elif kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    elif kind is int and isinstance(value, int) and not isinstance(value, bool):
        return value
    expected = getattr(kind, "__name__", str(kind))
    raise ConfigurationError(f"{where} is {value!r} ({type(value).__name__}), expected {expected}.")


def configuration_to_dict(configuration: Configuration) -> dict[str, Any]:
    """`configuration` as dictionaries, lists, strings and numbers, for JSON; `configuration_from_dict` undoes it."""
    return json.loads(json.dumps(configuration, default=lambda v: dict(v) if isinstance(v, Mapping) else vars(v)))
