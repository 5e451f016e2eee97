"""Which joints have a coordinate of their own: mimic joints follow a leader, locked joints stand still."""

import fnmatch
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from .._errors import RobotError, UnknownNameError
from ._robot import Joint


def resolve_couplings(
    joints: list[Joint], m, ranges: list[tuple[float, float]], fixed: Mapping[str, float | None], source: str
) -> tuple[list[Joint], tuple[str, ...], list[float], list[float]]:
    """Number the independent joints and express the others by them.

    **Arguments**: `joints` as in the file; `m`, the compiled MuJoCo model, whose equality constraints are all joint
    couplings `y - y0 = a0 + a1 (x - x0)`; `ranges`, each joint's limits; `fixed`, positions of locked joints by name
    or pattern, None for the one nearest to zero; `source`, for messages.
    **Returns** the joints with coordinate, multiplier and offset set; the names of the independent ones; their lower
    and upper limits.
    """
    index = {joint.name: i for i, joint in enumerate(joints)}
    leader_of = _leaders(joints, m, source)
    roots = [_root(i, leader_of, joints, source) for i in range(len(joints))]

    value_of_root: dict[int, float] = {}
    leaders = [joint.name for i, joint in enumerate(joints) if roots[i][0] == i]
    for name, value in _by_name(fixed, index, leaders).items():
        i = index[name]
        low, high = ranges[i]
        value = min(max(0.0, low), high) if value is None else value
        if np.ndim(value) or not np.issubdtype(np.asarray(value).dtype, np.number) or not np.isfinite(value):
            raise RobotError(f"{source}: fixed[{name!r}] is {value!r}, expected a finite number.")
        if not low - 1e-9 <= value <= high + 1e-9:
            raise RobotError(f"{source}: fixed[{name!r}] is {value}, outside the joint's range [{low}, {high}].")
        root, multiplier, offset = roots[i]
        position = value_of_root.get(root)
        if root >= 0 and multiplier != 0.0 and position is None:
            value_of_root[root] = (value - offset) / multiplier
        elif abs(multiplier * (position or 0.0) + offset - value) > 1e-9:
            raise RobotError(
                f"{source}: fixed[{name!r}] is {value}, but the coupling of this joint to the other locked joints "
                f"puts it at {multiplier * (position or 0.0) + offset:g}. Lock only one joint of a coupled group."
            )

    free = [i for i in range(len(joints)) if roots[i][0] == i and i not in value_of_root]
    if not free:
        raise RobotError(f"{source}: no joint is left to move. The file must hold a revolute or prismatic joint.")
    coordinate = {i: k for k, i in enumerate(free)}
    resolved = []
    for joint, (root, multiplier, offset) in zip(joints, roots, strict=True):
        if root in coordinate and multiplier != 0.0:
            follows = {"coordinate": coordinate[root], "multiplier": multiplier, "offset": offset}
        else:
            position = multiplier * value_of_root.get(root, 0.0) + offset
            follows = {"coordinate": -1, "multiplier": 0.0, "offset": position}
        resolved.append(joint._replace(**follows))
    names = tuple(joints[i].name for i in free)
    return resolved, names, [ranges[i][0] for i in free], [ranges[i][1] for i in free]


def _by_name(fixed: Mapping[str, Any], joints: Collection[str], leaders: list[str]) -> dict[str, Any]:
    """A pattern as the joints that match it and follow no other; a joint's own name counts before any pattern."""
    found = {}
    for pattern, value in fixed.items():
        if pattern not in joints and any(c in pattern for c in "*?["):
            names = fnmatch.filter(leaders, pattern)
            if not names:
                raise UnknownNameError("pattern of joints in fixed", pattern, leaders, "It matches none of these.")
            found |= {name: value for name in names if name not in fixed}
        else:
            UnknownNameError.check("joint", pattern, joints)
            found[pattern] = value
    return found


def _leaders(joints: list[Joint], m, source: str) -> dict[int, tuple[int, float, float]]:
    """The couplings in the file: follower -> (leader or -1, multiplier, offset)."""
    leader_of = {}
    for k in range(m.neq):
        follower, leader = int(m.eq_obj1id[k]), int(m.eq_obj2id[k])
        a = [float(v) for v in m.eq_data[k][:5]]
        name = joints[follower].name
        if any(a[2:]) and leader >= 0:
            raise RobotError(
                f"{source}: joint {name!r} follows {joints[leader].name!r} by the polynomial {a}; "
                "jaxrmp's mimic joints are linear (multiplier and offset)."
            )
        if follower in leader_of:
            raise RobotError(f"{source}: joint {name!r} follows more than one joint.")
        multiplier = a[1] if leader >= 0 else 0.0
        x0 = joints[leader].reference if leader >= 0 else 0.0
        leader_of[follower] = (leader, multiplier, joints[follower].reference + a[0] - multiplier * x0)
    return leader_of


def _root(i: int, leader_of, joints: list[Joint], source: str) -> tuple[int, float, float]:
    """The joint that `i` follows in the end (itself, or -1 for none), and the multiplier and offset to it."""
    multiplier, offset, seen = 1.0, 0.0, [i]
    while i in leader_of:
        i, a, b = leader_of[i]
        multiplier, offset = multiplier * a, multiplier * b + offset
        if i in seen:
            raise RobotError(f"{source}: joints {[joints[j].name for j in seen]} follow each other in a circle.")
        if i < 0:
            break
        seen.append(i)
    return i, multiplier, offset
