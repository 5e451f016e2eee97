"""Spheres on a robot, and which of them may meet, from the file that the robot was read from."""

import contextlib
import json
import warnings
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np

from .._counted import counted
from .._errors import ConfigurationError, FileWarning
from ..kinematics import Robot
from ..kinematics._robot_file import line_of_robot_file, toml_key
from ._cover import TooFineError
from ._mostly_touching import without_mostly_touching
from ._panda_cover import built_in_cover
from ._robot_spheres import RobotSpheres, bodies_with_geometry, cover_model, geometry_of_model
from ._self_pairs import MOST_PAIRS, ignored_by_model, link_of, self_pairs

_FINENESS = (0.008, 0.015, 0.03, 0.06)  # m, how far spheres may stick out; the first is for hands
# Spheres, the larger of the two: the first fineness that does with as many is taken, else the last.
_ENOUGH, _ENOUGH_A_JOINT = 100, 6
_LADDER = (0.006, 0.008, 0.01, 0.012, 0.015, 0.02, 0.025, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.15)  # m, for a `count`
_MORE_PAIRS = 16  # times as many at most where spheres may stick out half as far: a UR10 has 10 and 15
_NAMED = 8  # pairs of links that a warning names


def own_spheres(robot: Robot, hand: str | Sequence[str] | None = None, *, count: int | None = None) -> RobotSpheres:
    """Spheres that cover a `robot`, from the geometry of its own file: for the built-in Panda, `panda_spheres()`,
    which need no MuJoCo, as those on its hand do.

    They stick out of it by the `cover_error` at most that the robot was loaded with (`load_robot`). Where it says none,
    by 1.5 cm, or by 3 where else there would be more than 100, or 6 a joint. Where 3 are too fine, links
    that no joint moves, which avoid nothing by themselves, are covered to 6 cm in any number of spheres, and the others
    again to 1.5, 3 or 6 cm. The result's `coverage_error` is that of the coarsest. The link of the frame `hand`, or of
    each of several, and what it carries, which pass close to things, are covered to 8 mm if possible. Spheres are found
    once, and kept on disk (`spheres_from_model`).

    With a `count`, such as 40 for an arm, it is instead the finest cover by so many spheres at most, all links alike;
    `coverage_error` says how fine that is.
    **Raises** `NoGeometryError`, a `RobotError`, if the robot was read from no file or its file has no geometry,
    `RobotError` if that cannot be read (meshes that are not there), `ConfigurationError` if 6 cm, or what the robot
    says, are too fine, or so few spheres as `count` cannot cover it, `UnknownNameError` for a frame that is not there.
    """
    if count is not None:
        if hand is not None:
            raise ConfigurationError("count is for a cover without a finer hand: give the one or the other.")
        return _by_count(robot, count)
    links = {link_of(robot, name) for name in ((hand,) if isinstance(hand, str) else hand or ())}
    if (cover := built_in_cover(robot)) is not None and not robot.model.cover_error:
        carried = carried_by(robot, links, cover.spheres.frames)
        if not carried:
            return cover.spheres
        if carried == set(cover.hand.frames):
            return _with_fine(cover.spheres, cover.hand)
    return found_spheres(robot, links)


def _by_count(robot: Robot, count: int) -> RobotSpheres:
    """The finest of `_LADDER` by at most `count` spheres, by bisection."""
    model = geometry_of_model(robot)
    only = _bodies_of(robot, model)
    best, low, high = None, 0, len(_LADDER)
    while low < high:
        middle = (low + high) // 2
        found = _within(model, robot.source, _LADDER[middle : middle + 1], only, count)
        best, low, high = (best, middle + 1, high) if found is None else (found, low, middle)
    if best is None:
        parts = len(only or bodies_with_geometry(model))
        raise ConfigurationError(
            f"count={count} spheres cannot cover {robot.name!r}, of {parts} links with geometry, to {_LADDER[-1]} m: "
            "give more."
        )
    return best


def _bodies_of(robot: Robot, model: Any) -> tuple[str, ...] | None:
    """Those of a file's bodies with geometry that are the robot's, which may be a branch; None for all."""
    covered, own = bodies_with_geometry(model).values(), {body.name for body in robot.model.bodies}
    bodies = tuple(name for name in covered if name in own)
    return None if len(bodies) == len(covered) else bodies


def found_spheres(robot: Robot, links: Collection[int] = ()) -> RobotSpheres:
    """`own_spheres`, found from the robot's file, whoever's it is, with the bodies `links` and what they carry fine."""
    model = geometry_of_model(robot)
    most = max(_ENOUGH, _ENOUGH_A_JOINT * robot.num_joints)
    only, asked = _bodies_of(robot, model), robot.model.cover_error
    bodies = only or tuple(bodies_with_geometry(model).values())
    if asked:
        whole = cover_model(model, asked, only, robot.source)
        links = () if asked <= _FINENESS[0] else links
    else:
        whole = _within(model, robot.source, _FINENESS[1:-1], only, most)
    if whole is None:
        still = tuple(name for name in bodies if link_of(robot, name) == 0)
        moved = tuple(name for name in bodies if name not in still)
        fineness = _FINENESS[1:] if still else _FINENESS[-1:]
        parts = [_finest(model, robot.source, fineness, moved, most)] if moved else []
        parts += [cover_model(model, _FINENESS[-1], still, robot.source)] if still else []
        whole = _together(parts)
    carried = carried_by(robot, links, bodies)
    if not carried:
        return whole
    return _with_fine(whole, _finest(model, robot.source, _FINENESS, tuple(n for n in bodies if n in carried), most))


def carried_by(robot: Robot, links: Collection[int], names: Iterable[str]) -> set[str]:
    """Those of the bodies `names` that `links` are, or carry."""
    of_robot = {body.name: i for i, body in enumerate(robot.model.bodies)}
    return {name for name in names if not set(links).isdisjoint(robot.model.path(of_robot[name]))}


def _with_fine(whole: RobotSpheres, fine: RobotSpheres) -> RobotSpheres:
    """The spheres `fine` on their bodies, and those of `whole` on others."""
    rest = whole.rows([i for i, name in enumerate(whole.frames) if name not in fine.frames])
    return _together([fine, rest])


def own_self_pairs(robot: Robot, spheres: RobotSpheres) -> tuple[tuple[int, int], ...]:
    """The pairs of `spheres` that must not meet, by `self_pairs` and what the own file of `robot` excludes, or it was
    loaded to `ignore` (`load_robot`).

    Where two links touch in more than a quarter of random configurations, spheres are too coarse to tell, and would
    push nearly always: their pairs that touch most often are left out, and a `FileWarning` names the links, the first
    eight of many.
    """
    ignored = {name: list(others) for name, others in (ignored_by_model(robot) if robot.source else {}).items()}
    for name, other in robot.model.ignore:
        ignored.setdefault(name, []).append(other)
    pairs = self_pairs(robot, spheres.frames, ignored)
    kept = without_mostly_touching(robot, spheres, pairs)
    if links := sorted({(spheres.frames[i], spheres.frames[j]) for i, j in set(pairs) - set(kept)}):
        left = [f"{a} - {b}" for a, b in links]
        more = f" and {len(left) - _NAMED} more pairs of links" if len(left) > _NAMED else ""
        warnings.warn(
            f"{robot.name!r}: {counted(len(pairs) - len(kept), 'pair of spheres')} on {', '.join(left[:_NAMED])}{more} "
            "touch too often to tell, and are not kept apart; any other pairs on these links are. "
            f"{mend_cover(robot, spheres, links[:_NAMED], pairs, finer=not robot.model.cover_error)}",
            FileWarning,
            stacklevel=3,
        )
    return kept


def mend_cover(
    robot: Robot,
    spheres: RobotSpheres,
    links: Sequence[tuple[str, str]],
    pairs: Sequence[tuple[int, int]],
    *,
    finer: bool = True,
) -> str:
    """What to do where `spheres` on some pairs of `links` of a `robot` overlap, in words.

    With `finer`, a cover half as coarse, unless the `pairs` of spheres that must not meet would be too many by it.
    """
    half = f"{max(spheres.coverage_error / 2, 1e-3):.2g}" if np.isfinite(spheres.coverage_error) else "0.008"
    touched = {first: [b for a, b in links if a == first] for first, _ in links}
    lines = " and ".join(f"`{toml_key('ignore', first)} = {json.dumps(others)}`" for first, others in touched.items())
    if not finer or _MORE_PAIRS * len(pairs) > MOST_PAIRS:
        return (
            "Where covers overlap and the links do not, as next to a joint, or where the links may touch, say so: "
            f"{line_of_robot_file(lines.strip('`'), robot.source, robot.model.robot_file)}. "
            "Nothing keeps those links apart then."
        )
    said = line_of_robot_file(f"cover_error = {half}", robot.source, robot.model.robot_file)
    return (
        f"Have a finer cover, which takes longer to avoid: {said}. Or, if the links may touch, or only their covers "
        f"do, say {lines} there."
    )


def _together(parts: list[RobotSpheres]) -> RobotSpheres:
    return RobotSpheres(
        tuple(name for part in parts for name in part.frames),
        np.concatenate([part.offsets for part in parts]),
        np.concatenate([part.radii for part in parts]),
        max(part.coverage_error for part in parts),
    )


def _finest(model: Any, source: str, fineness: tuple[float, ...], frames: Any, most: int) -> RobotSpheres:
    """Within `most` spheres as fine as possible; of the last fineness in any number."""
    found = _within(model, source, fineness[:-1], frames, most)
    return cover_model(model, fineness[-1], frames, source) if found is None else found


def _within(model: Any, source: str, fineness: tuple[float, ...], frames: Any, most: int) -> RobotSpheres | None:
    for error in fineness:
        with contextlib.suppress(TooFineError):
            return cover_model(model, error, frames, source, most)
    return None
