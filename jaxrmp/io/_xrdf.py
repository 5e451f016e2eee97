"""NVIDIA's Extended Robot Description Format: what a URDF does not say."""

import os
import warnings
from typing import NamedTuple

import numpy as np

from .._errors import ConfigurationError, FileWarning, UnknownNameError, UnsafeFileWarning
from ..world import RobotSpheres
from ._yaml import Setting, read_yaml

_NEWEST = 2.0  # format_version
# In files, but nothing that an RMPflow policy goes by: other planners use them.
_INACTIVE_IN_CSPACE = (
    *("acceleration_limits", "jerk_limits", "velocity_limits", "default_cspace_position"),
    *("retract_config", "cspace_distance_weight", "null_space_weight"),
)


class Xrdf(NamedTuple):
    """What a robot description says, as settings that know their line in the file.

    `joint_names` of its cspace; `default_joint_positions` by joint, rad or m; `tool_frames`; `world_spheres`, for
    obstacles; `modifiers`, frames that it adds and the base that it sets; `lines`, where each frame was named.
    """

    joint_names: Setting
    default_joint_positions: dict[str, Setting]
    tool_frames: tuple[str, ...]
    world_spheres: RobotSpheres
    modifiers: list[Setting]
    lines: dict[str, Setting]


def read_xrdf(path: str | os.PathLike) -> Xrdf:
    """Read the XRDF file at `path`, of format version 1 or 2.

    A radius below zero is a sphere where its frame's buffer makes it positive, and none otherwise. Of a key given
    twice the last counts. Warns with `FileWarning` of that, of spheres that are off and of keys that nothing acts on;
    with `UnsafeFileWarning` if there are no spheres, or two lists of them for one frame.
    **Raises** `ConfigurationError` naming the key and the line of a value that is missing or of a wrong type;
    `UnknownNameError` for a key that is not XRDF's.
    """
    repeats = []
    top = read_yaml(path, repeats)
    told: dict[type[FileWarning], list[str]] = {UnsafeFileWarning: [], FileWarning: []}
    for setting, first, same in repeats:
        covers = setting.key.split(".")[0] in ("geometry", "collision", "world_collision")
        said = f"key {setting.key}, line {setting.line}, was given in line {first.line} with "
        said += "the same value" if same else "another value, and the last counts"
        told[UnsafeFileWarning if covers and not same else FileWarning].append(said)
    for kind, sentences in told.items():
        if sentences:
            warn(f"{path}: {'; '.join(sentences)}. Leave one of each.", kind)
    keys = top.keys(
        ["format", "cspace"],
        [
            *("format_version", "default_joint_positions", "tool_frames", "modifiers", "geometry"),
            *("collision", "world_collision", "self_collision"),
        ],
    )
    if keys["format"].text() != "xrdf":
        keys["format"].refuse("xrdf")
    if "format_version" in keys and keys["format_version"].number() > _NEWEST:
        warn(f"{path}: format_version {keys['format_version'].content} is newer than {_NEWEST}, which is read here.")
    cspace = keys["cspace"].keys(["joint_names"], _INACTIVE_IN_CSPACE)
    inactive = [f"cspace.{key}" for key in _INACTIVE_IN_CSPACE if key in cspace]
    if "self_collision" in keys:
        # Lula's policies keep the arm off its own base by the capsules of their own file, not by this.
        keys["self_collision"].keys(["geometry"], ["ignore", "buffer_distance"])
        inactive.append("self_collision")
    if "collision" in keys and "world_collision" in keys:
        inactive.append("collision")
    if inactive:
        warn(f"{path}: no RMPflow policy acts on {', '.join(inactive)}.")
    defaults = keys["default_joint_positions"].section() if "default_joint_positions" in keys else {}
    tools = keys["tool_frames"].texts() if "tool_frames" in keys else []
    lines: dict[str, Setting] = dict.fromkeys(tools, keys["tool_frames"]) if tools else {}
    modifiers = keys["modifiers"].items() if "modifiers" in keys and keys["modifiers"].content else []
    spheres = _world_spheres(keys, lines, str(path))
    return Xrdf(cspace["joint_names"], defaults, tuple(tools), spheres, modifiers, lines)


def _world_spheres(keys: dict[str, Setting], lines: dict[str, Setting], path: str) -> RobotSpheres:
    collision = keys.get("world_collision", keys.get("collision"))
    entries = collision.keys(["geometry"], ["buffer_distance"]) if collision else {}
    if entries and "geometry" not in keys:
        entries["geometry"].fail("the file has no section geometry, in which it would be")
    buffers = entries["buffer_distance"].section() if "buffer_distance" in entries else {}
    lines.update(buffers)
    frames, centers, radii, off = [], [], [], []
    for frame, sphere in _spheres(keys["geometry"], entries["geometry"], lines, ()) if entries else ():
        numbers = sphere.keys(["center", "radius"])
        given = numbers["radius"].number()
        radius = given + (buffers[frame].number() if frame in buffers else 0.0)
        if given >= 0 > radius:
            buffers[frame].fail(f"the distance leaves a sphere of {frame} the radius {radius:g}, less than nothing")
        if given < 0 and radius <= 0:
            off.append(frame)
            continue
        frames.append(frame)
        centers.append(numbers["center"].numbers(3))
        radii.append(radius)
    if off:
        named = ", ".join(dict.fromkeys(off))
        warn(
            f"{path}: {len(off)} spheres of {named} are off, since their radius is below zero, as of places kept for "
            "what is held. If it is held now, give them its radius."
        )
    if not frames:
        warn(f"{path} gives the robot no spheres (world_collision): it avoids no obstacle.", UnsafeFileWarning)
    return RobotSpheres(tuple(frames), np.array(centers).reshape(-1, 3), np.array(radii))


def _spheres(geometry: Setting, name: Setting, lines: dict[str, Setting], within: tuple[str, ...]):
    """Each (frame, sphere) of a named geometry, those of the geometries that it clones first."""
    sets = geometry.section()
    UnknownNameError.check("geometry", name.text(), sets, f"{name.source} names it in line {name.line}.")
    if name.text() in within:
        raise ConfigurationError(f"{name.source}: key {name.key}, line {name.line}: geometry clones itself.")
    entries = sets[name.text()].keys([], ["spheres", "clone"])
    if "clone" in entries:
        clones = entries["clone"]
        for other in clones.items() if isinstance(clones.content, list) else [clones]:
            yield from _spheres(geometry, other, lines, (*within, name.text()))
    if "spheres" in entries:
        for frame, spheres in entries["spheres"].section().items():
            lines.setdefault(frame, spheres)
            for sphere in spheres.items():
                yield frame, sphere


def warn(what: str, kind: type[FileWarning] = FileWarning) -> None:
    """Warn of what a file says, from where it was asked for."""
    warnings.warn(what, kind, stacklevel=4)
