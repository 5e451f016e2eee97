"""`--KEY VALUE` pairs of the command line as configuration overrides."""

import tomllib
from collections.abc import Sequence
from typing import Any

from .._errors import ConfigurationError


def parse_overrides(arguments: Sequence[str]) -> dict[str, Any]:
    """Values by dotted key from `--KEY VALUE` or `--KEY=VALUE`; a value is read as TOML, or else as plain text.

    **Raises** `ConfigurationError` for a key without a value, or a value without a key.
    """
    overrides: dict[str, Any] = {}
    left = list(arguments)
    while left:
        key = left.pop(0)
        if not key.startswith("--") or key == "--":
            raise ConfigurationError(f"{key!r} is no configuration key: write --KEY VALUE.")
        key, equals, text = key.removeprefix("--").partition("=")
        if not equals:
            if not left or left[0].startswith("--"):
                raise ConfigurationError(f"--{key} has no value: write --{key} VALUE.")
            text = left.pop(0)
        try:
            overrides[key] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            overrides[key] = text
    return overrides
