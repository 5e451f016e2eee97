"""NVIDIA's Extended Robot Description Format: what a URDF does not say."""

import os
from typing import NamedTuple

import numpy as np

from .._errors import ConfigurationError, UnknownNameError
from ..world import RobotSpheres
from ._yaml import Setting, read_yaml


class Xrdf(NamedTuple):
    """What a robot description says: joints, their default positions, frames, and spheres."""

    joint_names: tuple[str, ...]
    default_joint_positions: dict[str, float]
    tool_frames: tuple[str, ...]
    world_spheres: RobotSpheres
    lines: dict[str, Setting]  # where a frame was named, for errors


def read_xrdf(path: str | os.PathLike) -> Xrdf:
    """Read an XRDF file of format version 1 or 2.

    **Raises** `ConfigurationError` naming the key and the line of a value that is missing or of a wrong type, of a
    negative radius, and for `modifiers`, which change the kinematics; `UnknownNameError` for a key that is not XRDF's.
    """
    top = read_yaml(path)
    keys = top.keys(
        ["format", "default_joint_positions", "cspace", "geometry"],
        ["format_version", "tool_frames", "collision", "world_collision", "self_collision", "modifiers"],
    )
    if keys["format"].text() != "xrdf":
        keys["format"].refuse("xrdf")
    if "modifiers" in keys and keys["modifiers"].content:
        keys["modifiers"].fail("modifiers are not supported; write their frames into the URDF")
    joints = keys["cspace"].keys(["joint_names"], ["acceleration_limits", "jerk_limits", "velocity_limits"])
    joint_names = tuple(joints["joint_names"].texts())
    defaults = {name: value.number() for name, value in keys["default_joint_positions"].section().items()}
    for name in joint_names:
        if name not in defaults:
            keys["default_joint_positions"].fail(f"joint {name} of cspace has no position here")
    lines: dict[str, Setting] = {}
    if "self_collision" in keys:
        # Lula's policies keep the arm off its own base by the capsules of their own file, not by this.
        keys["self_collision"].keys(["geometry"], ["ignore", "buffer_distance"])
    tools = keys["tool_frames"].texts() if "tool_frames" in keys else []
    lines.update((frame, keys["tool_frames"]) for frame in tools)
    return Xrdf(joint_names, defaults, tuple(tools), _world_spheres(keys, lines), lines)


def _world_spheres(keys: dict[str, Setting], lines: dict[str, Setting]) -> RobotSpheres:
    collision = keys.get("world_collision", keys.get("collision"))
    if collision is None:
        return RobotSpheres((), np.zeros((0, 3)), np.zeros(0))
    entries = collision.keys(["geometry"], ["buffer_distance"])
    buffers = entries["buffer_distance"].section() if "buffer_distance" in entries else {}
    lines.update(buffers)
    frames, centers, radii = [], [], []
    for frame, sphere in _spheres(keys["geometry"], entries["geometry"], lines, ()):
        numbers = sphere.keys(["center", "radius"])
        radius = numbers["radius"].number()
        if radius < 0:
            numbers["radius"].fail(f"a radius must not be negative, received {radius}")
        if frame in buffers:
            radius += buffers[frame].number()
            if radius < 0:
                buffers[frame].fail(f"the distance leaves a sphere of {frame} the radius {radius:g}, less than nothing")
        frames.append(frame)
        centers.append(numbers["center"].numbers(3))
        radii.append(radius)
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
