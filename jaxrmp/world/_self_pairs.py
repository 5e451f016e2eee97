"""Which spheres of a robot may meet which."""

import functools
import os
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from .._errors import ConfigurationError, UnknownNameError
from ..kinematics import Robot, panda
from ._panda_cover import built_in_cover, panda_cover, panda_spheres
from ._robot_spheres import geometry_of_model

MOST_PAIRS = 20_000
"""Of points that must be kept apart: with more, a policy takes minutes to compile and gigabytes to run in batches."""


def self_pairs(
    robot: Robot, frames: Sequence[str], ignore: Mapping[str, Iterable[str]] | None = None
) -> tuple[tuple[int, int], ...]:
    """The pairs of points on different links that a robot must keep apart.

    All pairs but those on the same link, on links next to each other (one joint, or none, between them: links that
    are rigidly joined count as one), and on links that `ignore` pairs.

    **Arguments**: `robot`; `frames`, the frame of each point, as `RobotSpheres.frames`; `ignore`, for a frame the
    frames that it may touch, as in an XRDF's `self_collision`; each holds both ways.
    **Returns** pairs (i, j), i < j, for `SelfDistances`. **Raises** `UnknownNameError` for a frame that is not there,
    `ConfigurationError` for more pairs than a policy can have, `MOST_PAIRS`.
    """
    links = {name: link_of(robot, name) for name in frames}
    bodies = robot.model.bodies
    roots = [robot.model.rigid_root(b) for b in range(len(bodies))]
    touching = {frozenset((root, roots[bodies[root].parent])) for root in roots if root > 0}  # one joint between them
    for name, others in (ignore or {}).items():
        for pair in ((name, other) for other in others):
            for frame in pair:
                UnknownNameError.check("frame in ignore", frame, robot.frame_names)
            touching.add(frozenset(pair))
    names = list(links)
    apart = [
        [links[a] != links[b] and not {frozenset((links[a], links[b])), frozenset((a, b))} & touching for b in names]
        for a in names
    ]
    at = np.array([names.index(name) for name in frames], int)
    meet = np.tril(np.array(apart, bool).reshape(len(names), len(names))[np.ix_(at, at)], -1)
    if (count := int(meet.sum())) > MOST_PAIRS:
        raise ConfigurationError(
            f"{len(frames)} points on {robot.name!r} make {count} pairs, more than {MOST_PAIRS}. Have fewer spheres: "
            f"{_fewer(robot)}."
        )
    return tuple((int(i), int(j)) for j, i in np.argwhere(meet))


def _fewer(robot: Robot) -> str:
    """What makes fewer spheres, by what a `robot` was loaded with."""
    in_python = "world.own_spheres(robot, count=40), or a larger max_error"
    if not robot.model.cover_error:
        return in_python
    where = f" in {robot.model.robot_file}" if robot.model.robot_file else ""
    return f"a larger cover_error{where} than {robot.model.cover_error:g}, or, in Python, {in_python}"


def ignored_by_model(source: str | os.PathLike | Robot) -> dict[str, tuple[str, ...]]:
    """For each body of the file `source`, or of a robot, those it never touches in simulation, as for `self_pairs`.

    These are the pairs that `contact/exclude` names, and those of which no two geometries have `contype` and
    `conaffinity` that meet. Bodies without geometry that collides are left out.

    **Raises** `RobotError` if the file cannot be read.
    """
    if isinstance(source, Robot) and (cover := built_in_cover(source)) is not None:
        return cover.ignored
    return found_ignored(source)


def found_ignored(source: str | os.PathLike | Robot) -> dict[str, tuple[str, ...]]:
    """`ignored_by_model`, found from the file, whoever's it is."""
    m = geometry_of_model(source)
    meets = (m.geom_contype[:, None] & m.geom_conaffinity) | (m.geom_conaffinity[:, None] & m.geom_contype)
    bodies = sorted({int(m.geom_bodyid[g]) for g in range(m.ngeom) if m.geom_contype[g] or m.geom_conaffinity[g]})
    if isinstance(source, Robot):  # which may be a branch of its file
        bodies = [body for body in bodies if m.body(body).name in source.model.frame_of_name]
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in m.exclude_signature}
    ignored = {}
    for first in bodies:
        names = []
        for second in bodies:
            touch = meets[np.ix_(m.geom_bodyid == first, m.geom_bodyid == second)].any()
            if first != second and (not touch or {(first, second), (second, first)} & excluded):
                names.append(m.body(second).name)
        if names:
            ignored[m.body(first).name] = tuple(names)
    return ignored


@functools.cache
def panda_self_pairs(max_error: float = 0.015) -> tuple[tuple[int, int], ...]:
    """The pairs of `panda_spheres`, of the same `max_error`, that can meet: wrist and hand against the base."""
    return self_pairs(panda(), panda_spheres(max_error).frames, panda_cover().ignored)


def link_of(robot: Robot, name: str) -> int:
    """The body that carries the frame and all that is rigidly joined to it."""
    return robot.model.rigid_root(robot.model.frames[robot.frame_index(name)].body)
