"""YAML values that know where they stand, so that an error can say which key of which line is wrong.

YAML 1.1 takes `1e-3` for a string and `no` for false. So nothing here goes by the loader's guess: it gives the text of
every value, and the reader says what it expects.
"""

import dataclasses
import math
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from .._errors import ConfigurationError, UnknownNameError, importing


@dataclasses.dataclass(frozen=True)
class Setting:
    """A value of a YAML file: `content` is a dict or a list of settings, or the text of a scalar."""

    content: Any
    key: str  # dotted path from the top
    line: int
    source: str
    is_quoted: bool = False

    def number(self) -> float:
        """A finite number."""
        try:
            value = math.nan if self.is_quoted else float(self.content)
        except (TypeError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            self.refuse("a number")
        return value

    def numbers(self, count: int | None = None) -> list[float]:
        """A list of finite numbers, `count` of them if given."""
        if not isinstance(self.content, list) or (count is not None and len(self.content) != count):
            self.refuse("a list of numbers" if count is None else f"a list of {count} numbers")
        return [entry.number() for entry in self.content]

    def text(self) -> str:
        """A string."""
        if not isinstance(self.content, str):
            self.refuse("a name")
        return self.content

    def texts(self) -> list[str]:
        """A list of strings; one string stands for a list of one."""
        return [self.content] if isinstance(self.content, str) else [entry.text() for entry in self.items()]

    def boolean(self) -> bool:
        """True or false, in any spelling of YAML 1.1."""
        word = self.content.lower() if isinstance(self.content, str) else ""
        if word not in _BOOLEANS:
            self.refuse("true or false")
        return _BOOLEANS[word]

    def items(self) -> list["Setting"]:
        """The entries of a list."""
        if not isinstance(self.content, list):
            self.refuse("a list")
        return self.content

    def section(self) -> dict[str, "Setting"]:
        """The entries of a mapping of any keys."""
        if not isinstance(self.content, dict):
            self.refuse("a mapping")
        return self.content

    def keys(self, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, "Setting"]:
        """The entries of a mapping that must have the `required` keys and may have the `optional` ones.

        **Raises** `UnknownNameError` for any other key, `ConfigurationError` for a missing one.
        """
        section, required = self.section(), list(required)
        for key, value in section.items():
            if key not in (valid := [*required, *optional]):
                kind = f"key of {self.key}" if self.key else "key"
                raise UnknownNameError(kind, key, valid, f"It is in {self.source}, line {value.line}.")
        missing = [key for key in required if key not in section]
        if missing:
            where = f"{self.key}, line {self.line}" if self.key else "the file"
            raise ConfigurationError(f"{self.source}: {where} lacks the keys {', '.join(missing)}.")
        return section

    def refuse(self, expected: str) -> NoReturn:
        """**Raises** `ConfigurationError`: this value is not what it should be."""
        kind = "mapping" if isinstance(self.content, dict) else "list"
        shown = repr(self.content) if isinstance(self.content, str) else f"a {kind} of {len(self.content)}"
        self.fail(f"expected {expected}, received {shown}")

    def fail(self, what: str) -> NoReturn:
        """**Raises** `ConfigurationError`: `what` is wrong at this place."""
        raise ConfigurationError(f"{self.source}: key {self.key or '(top)'}, line {self.line}: {what}.")


_BOOLEANS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}


class Repeat(NamedTuple):
    """A key that was given again: the last `setting` counts, as for other readers; was it `same` as the `first`?"""

    setting: Setting
    first: Setting
    same: bool


def read_yaml(path: str | os.PathLike, repeats: list[Repeat] | None = None) -> Setting:
    """Read a YAML file. Keys that are given again are added to `repeats`.

    **Raises** `ConfigurationError` if it cannot be read, or, without a list of `repeats`, names a key twice.
    """
    with importing("PyYAML", "formats"):
        import yaml
    source = str(path)
    try:
        # The base loader leaves every scalar as it is written.
        node = yaml.compose(Path(path).read_text(encoding="utf-8"), Loader=yaml.BaseLoader)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{source} cannot be read: {error}") from error
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{source} is not YAML: {' '.join(str(error).split())}") from error
    if node is None:
        raise ConfigurationError(f"{source} is empty.")
    return _setting(yaml, node, "", source, node.start_mark.line + 1, repeats)


def _setting(yaml, node, key: str, source: str, line: int, repeats: list[Repeat] | None) -> Setting:
    if isinstance(node, yaml.MappingNode):
        section: dict[str, Setting] = {}
        for name_node, value in node.value:
            name, at = str(name_node.value), name_node.start_mark.line + 1
            path = f"{key}.{name}" if key else name
            first = section.get(name)
            if first and repeats is None:
                raise ConfigurationError(f"{source}: key {path}, line {at}, was given in line {first.line}.")
            section[name] = _setting(yaml, value, path, source, at, repeats)
            if first and repeats is not None:
                repeats.append(Repeat(section[name], first, _plain(section[name]) == _plain(first)))
        return Setting(section, key, line, source)
    if isinstance(node, yaml.SequenceNode):
        entries = enumerate(node.value)
        return Setting(
            [_setting(yaml, entry, f"{key}[{i}]", source, entry.start_mark.line + 1, repeats) for i, entry in entries],
            *(key, line, source),
        )
    return Setting(node.value, key, line, source, is_quoted=node.style in ("'", '"'))


def _plain(setting: Setting) -> Any:
    content = setting.content
    if isinstance(content, dict):
        return {key: _plain(value) for key, value in content.items()}
    return [_plain(entry) for entry in content] if isinstance(content, list) else content
