"""A robot as plain numbers: what a skill file carries of it, and what the package has of the built-in one."""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._errors import RobotError
from ._robot import Body, Frame, Joint, KinematicModel, Robot

_HERE = Path(__file__).parent
_KEYS = ("name", "joint_names", "bodies", "joints", "frames", "source", "packages", "lower", "upper", "velocity")
_COVER = ("ignore", "cover_error")  # which a record has only where they were said
_LIMITS = {"lower": -math.inf, "upper": math.inf, "velocity": math.inf}  # and what there is where there is none
_NUMBERS = {"position": 3, "rotation": 9, "axis": 3, "anchor": 3}


class RobotRecord(NamedTuple):
    """A `Robot` of n joints as a value that is hashable and equal to another of the same content.

    `model`, its kinematics; `lower`, `upper` and `velocity_limit`, n Python numbers each, as `Robot` has them.
    """

    model: KinematicModel
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    velocity_limit: tuple[float, ...]

    def robot(self) -> Robot:
        """The robot, its limits in double precision."""
        return Robot(np.array(self.lower), np.array(self.upper), np.array(self.velocity_limit), self.model)


def record_of(robot: Robot) -> RobotRecord:
    """The `robot` as a record. Its limits must be numbers, not traced by JAX."""
    limits = (robot.lower, robot.upper, robot.velocity_limit)
    return RobotRecord(robot.model, *(tuple(np.asarray(limit, float).tolist()) for limit in limits))


def record_to_dict(record: RobotRecord) -> dict[str, Any]:
    """What JSON can hold of a `record`, exactly; `record_from_dict` makes the same record of it.

    A limit that there is not is null. A file within this package is named from its folder of kinematics.
    """
    model, limits = record.model, record[1:]
    source = model.source
    if source is not None and Path(source).is_relative_to(_HERE.resolve()):
        source = Path(source).relative_to(_HERE.resolve()).as_posix()
    content = {"name": model.name, "joint_names": list(model.joint_names), "source": source}
    for key in ("bodies", "joints", "frames"):
        content[key] = [part._asdict() for part in getattr(model, key)]
    for (key, none), limit in zip(_LIMITS.items(), limits, strict=True):
        content[key] = [None if value == none else value for value in limit]
    cover = {"ignore": [list(pair) for pair in model.ignore], "cover_error": model.cover_error}
    return content | {"packages": dict(model.packages)} | {key: value for key, value in cover.items() if value}


def record_from_dict(content: dict[str, Any]) -> RobotRecord:
    """The record of the `content` that `record_to_dict` made. **Raises** `RobotError` for what that would not make."""
    if not isinstance(content, dict) or set(content) - set(_COVER) != set(_KEYS):
        raise RobotError(f"a robot's record has {sorted(content)}, expected {sorted(_KEYS)}.")
    try:
        bodies, joints, frames = (
            tuple(_part(kind, part) for part in content[key])
            for key, kind in (("bodies", Body), ("joints", Joint), ("frames", Frame))
        )
        names = tuple(map(str, content["joint_names"]))
        limits = (
            tuple(none if value is None else float(value) for value in content[key]) for key, none in _LIMITS.items()
        )
        source = content["source"]
        source = None if source is None else str(Path(_HERE.resolve(), source))
        packages = tuple(content["packages"].items())
        ignore = tuple((str(a), str(b)) for a, b in content.get("ignore", ()))
        cover = ignore, float(content.get("cover_error", 0.0))
        model = KinematicModel(content["name"], names, bodies, joints, frames, source, packages, *cover)
        record = RobotRecord(model, *limits)
        _check(record)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RobotError(f"a robot's record cannot be read: {error}") from error
    return record


def _part(kind: type[Any], content: dict[str, Any]) -> Any:
    """A body, joint or frame; numbers and rows of them as they were."""
    values = {key: tuple(map(float, value)) if key in _NUMBERS else value for key, value in content.items()}
    for key, count in _NUMBERS.items():
        if key in values and not (len(values[key]) == count and all(map(math.isfinite, values[key]))):
            raise ValueError(f"{key} of {content['name']!r} is {content[key]!r}, expected {count} numbers.")
    return kind(**values)


def _check(record: RobotRecord) -> None:
    """**Raises** `ValueError` where the parts of a robot do not belong together."""
    model, n = record.model, len(record.model.joint_names)
    at = [body.parent < i for i, body in enumerate(model.bodies)]
    at += [0 <= part.body < len(model.bodies) for part in (*model.joints, *model.frames)]
    at += [-1 <= joint.coordinate < n and joint.kind in ("revolute", "prismatic") for joint in model.joints]
    if not model.bodies or not all(at) or any(len(limit) != n for limit in record[1:]):
        raise ValueError(f"the parts of {model.name!r} do not belong together.")
