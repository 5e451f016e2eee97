"""Gains in files: as TOML, and in a copy of a skill."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from .._counted import counted
from .._errors import ConfigurationError
from .._files import atomic_write
from ..learning import Skill, load_skill, save_skill
from ._inputs import gain_value, gains_of, with_gain


def write_gains(gains: dict[str, float], path: Path) -> None:
    """Write `gains`, by leaf.parameter, as TOML, which `jaxrmp view --gains` takes: a table for each leaf."""
    lines, leaf = ["# Gains of leaves, as they were set on the page of jaxrmp view."], ""
    for name, value in sorted(gains.items()):
        of, _, parameter = name.partition(".")
        lines += [f"\n[{of}]"] if of != leaf else []
        leaf = of
        lines.append(f"{parameter} = {json.dumps(float(value))}")
    with atomic_write(path) as file:
        file.write(("\n".join(lines) + "\n").encode())


def with_gains_of(policy: Any, path: Path) -> Any:
    """The `policy` with the gains of a TOML file.

    **Raises** `ConfigurationError` for a file that is none, a gain that the policy does not have, or no number.
    """
    try:
        tables = tomllib.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"--gains {path}: cannot be read as TOML: {error}") from error
    known = {gain.path: gain for gain in gains_of(policy)}
    for leaf, table in tables.items():
        for parameter, value in table.items() if isinstance(table, dict) else [("", table)]:
            name = f"{leaf}.{parameter}".rstrip(".")
            if name not in known:
                raise ConfigurationError(f"--gains {path}: {name} is no gain of this policy, which has: {list(known)}.")
            least = 0 if known[name].zero else np.finfo(float).tiny
            if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < np.inf:
                more = "zero or more" if known[name].zero else "more than zero"
                raise ConfigurationError(f"--gains {path}: {name} is {value!r}, expected a number, {more}.")
            policy = with_gain(policy, name, value)
    return policy


def place_for_gains(name: str) -> Path:
    """The file of this `name`, in the folder that the command runs in or below: whoever has the page has no other.

    **Raises** `ConfigurationError` for one that is elsewhere.
    """
    here = Path.cwd()
    if not (here / name).resolve().is_relative_to(here.resolve()):
        raise ConfigurationError(f"{name!r} is not in {here}, where the command runs: a page saves there, or below.")
    return Path(name)


def save_gains(gains: dict[str, float], path: Path, skill: Skill | None, replace: bool) -> str:
    """Write the changed `gains` to `path`, as TOML (`.toml`), or into a copy of the `skill` (`.npz`), and say in words
    what was written, and what a skill's file has no place for.

    **Raises** `ConfigurationError` for no gains, another ending, a file that is there unless it may `replace` it.
    """
    if not gains:
        raise ConfigurationError("no gain was changed: there is nothing to save.")
    if path.suffix not in (".toml", ".npz") or (path.suffix == ".npz" and skill is None):
        also = "" if skill is None else ", or in .npz, for a copy of the skill with them"
        raise ConfigurationError(f"{str(path)!r}: expected a name that ends in .toml, for the gains alone{also}.")
    if path.exists() and not replace:
        raise ConfigurationError(f"{path} is there already: choose another name, or say that it may be replaced.")
    if path.suffix == ".toml":
        write_gains(gains, path)
        return f"Saved {counted(len(gains), 'gain')} in {path}: `jaxrmp view --gains {path}` begins with them."
    changed: Any = skill
    for name, value in gains.items():
        if name in {gain.path for gain in gains_of(skill)}:
            changed = with_gain(changed, name, value)
    save_skill(changed, path)
    found = load_skill(path)
    has = {gain.path for gain in gains_of(found)}
    kept = [name for name, value in gains.items() if name in has and np.isclose(gain_value(found, name), value)]
    left = [name for name in gains if name not in kept]
    said = f"Saved a copy of the skill with {', '.join(kept) or 'none of them'} in {path}."
    return said + (f" Not in it, for a skill's file has no place for them: {', '.join(left)}." if left else "")
