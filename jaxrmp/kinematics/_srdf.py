"""SRDF, which MoveIt keeps beside a URDF: which links may touch."""

import os
import xml.etree.ElementTree as ET
from collections.abc import Collection
from pathlib import Path

from .._errors import RobotError


def read_srdf(path: str | os.PathLike, frames: Collection[str]) -> dict[str, list[str]]:
    """The links of an SRDF file that may touch, as `load_robot` takes them by `ignore`.

    Of `disable_collisions`, whatever the reason, and `disable_default_collisions` less `enable_collisions`. Pairs of
    links that are not among `frames`, such as those of a gripper that was left out, count for nothing.
    **Raises** `RobotError` for a file that is no SRDF, or none of whose links is there.
    """
    try:
        root = ET.fromstring(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ET.ParseError) as error:
        raise RobotError(f"{path} cannot be read as SRDF: {error}") from error
    if root.tag != "robot" or root.find("link") is not None:
        raise RobotError(f"{path} is no SRDF: expected a <robot> without links of its own.")
    apart = [_pair(entry, path) for entry in root.findall("disable_collisions")]
    wanted = {frozenset(_pair(entry, path)) for entry in root.findall("enable_collisions")}
    for entry in root.findall("disable_default_collisions"):
        (link,) = _named(entry, ("link",), path)
        apart += [(link, other) for other in frames if other != link and frozenset((link, other)) not in wanted]
    if apart and not {link for pair in apart for link in pair} & set(frames):
        raise RobotError(f"{path} is of another robot: none of its links is here, such as {apart[0][0]!r}.")
    ignored: dict[str, list[str]] = {}
    for first, second in apart:
        if first in frames and second in frames:
            ignored.setdefault(first, []).append(second)
    return ignored


def _pair(entry: ET.Element, path: str | os.PathLike) -> tuple[str, ...]:
    return _named(entry, ("link1", "link2"), path)


def _named(entry: ET.Element, names: tuple[str, ...], path: str | os.PathLike) -> tuple[str, ...]:
    for name in names:
        if not entry.get(name):
            raise RobotError(f"{path}: <{entry.tag}> lacks {name}.")
    return tuple(str(entry.get(name)) for name in names)
